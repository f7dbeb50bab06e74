"""Backup of a class as ZIP: records, courses, database rows as JSON."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from cutenv._base.output import atomic_write
from cutenv.people.classroom.class_courses import COURSE_FILE, COURSE_FOLDER, ClassCourses
from cutenv.people.classroom.class_store import PLACE_NAME, ClassStore
from cutenv.people.classroom.class_tables import KEPT

BACKUP_SCHEMA = "cutenv-class/1"
_ROWS = "class.json"
_CODE, _NAME = r"[A-Za-z0-9_-]{1,64}", r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,190}\.csv"
_RECORD = re.compile(rf"records/{_CODE}/{_NAME}")
_COURSE = re.compile(rf"{COURSE_FILE}|{COURSE_FOLDER}/{PLACE_NAME.pattern}\.toml")


def write_backup(store: ClassStore, records: Path, path: Path) -> int:
    """Write a class to a ZIP file atomically; return the number of records.

    It may run while people cut: rows are read first, so every saved cut among them has its record.
    """
    content = store.content()
    count = 0
    with atomic_write(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(_ROWS, json.dumps({"schema": BACKUP_SCHEMA, **content}, indent=1))
        for row in content["cuts"]:
            record = records / row["code"] / str(row["record"])
            if row["state"] in KEPT and record.is_file():
                archive.write(record, f"records/{row['code']}/{row['record']}")
                count += 1
        for course in ClassCourses(records.parent).files():
            archive.write(course, course.relative_to(records.parent).as_posix())
    return count


def restore_backup(store: ClassStore, records: Path, path: Path) -> int:
    """Restore an empty class from a backup; return the number of records, or raise ValueError."""
    try:
        with zipfile.ZipFile(path) as archive:
            content: dict[str, Any] = json.loads(archive.read(_ROWS))
            if content.get("schema") != BACKUP_SCHEMA:
                raise ValueError(f"{path}: its schema is {content.get('schema')!r}, not {BACKUP_SCHEMA!r}.")
            names = [name for name in archive.namelist() if name != _ROWS]
            for name in names:
                if not (_RECORD.fullmatch(name) or _COURSE.fullmatch(name)):
                    raise ValueError(f"{path}: {name!r} is no record of a class. Give a file from --backup.")
            _check_rows(path, content)
            if any(records.rglob("*.csv")):
                raise ValueError(f"{records} holds records already. Restore into a new folder.")
            try:
                store.fill(content)
            except (SQLAlchemyError, AttributeError, TypeError):  # whose text would print every row
                raise ValueError(f"{path}: its rows are damaged. Give a file from --backup.") from None
            for name in names:
                target = records.parent / name
                target.parent.mkdir(parents=True, exist_ok=True)
                with atomic_write(target) as part:
                    part.write_bytes(archive.read(name))
    except (zipfile.BadZipFile, KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is no backup of a class ({error}). Give a file from --backup.") from None
    return sum(bool(_RECORD.fullmatch(name)) for name in names)


def _check_rows(path: Path, content: dict[str, Any]) -> None:
    """Raise ValueError for names of people or records that escape the folder."""
    for table in ("people", "cuts"):
        for row in content[table]:
            code, record = row["code"], row.get("record")
            if not re.fullmatch(_CODE, str(code)) or (record and not re.fullmatch(_NAME, str(record))):
                raise ValueError(f"{path}: a row of {table!r} names no record of a class. Give a file from --backup.")
