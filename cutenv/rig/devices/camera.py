"""Camera beside the rig, read by a process that can delay nothing here."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from cutenv.rig.config.settings import CameraSettings

CAMERA_NOTE = "camera"  # key in a record's metadata under which stands what became of the camera's frames
_PATIENCE = 30.0  # for the depth to be put into a record [s]


class RigCamera:
    """Camera that measures the depth of cut.

    Its process begins at once, and its messages are kept as they come. ``settings``: the camera, its calibration and
    the blade's mark.
    """

    def __init__(self, settings: CameraSettings) -> None:
        # times of the frames since the cut began, used or not, on the machine's clock [s]
        self.moments: list[float] = []
        self.ended = ""  # why the camera has ended, or ""
        self._answered = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cutenv.envs.camera_process", json.dumps(dataclasses.asdict(settings))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the rig's program
        )
        threading.Thread(target=self._listen, name="camera", daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            told: dict[str, Any] = json.loads(line)
            if "frame" in told:
                self.moments.append(told["frame"])
            self.ended = told.get("ended", self.ended)
            if "record" in told:
                self._answered.set()
        self.ended = self.ended or "the camera's process was ended"
        self._answered.set()

    def begin(self) -> None:
        """Forget the frames so far: a cut begins."""
        self.moments.clear()
        self._ask({"begin": True})

    def put_depth(self, record: Path) -> None:
        """Put the depth into a finished record, and wait for it.

        A note is added under :data:`CAMERA_NOTE`. The record stays as it is if the camera's process is gone.
        """
        self._answered.clear()
        if self._ask({"record": str(record)}):
            self._answered.wait(_PATIENCE)

    def _ask(self, request: dict[str, Any]) -> bool:
        assert self._process.stdin is not None
        if self._process.poll() is not None:
            return False
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:  # it has just ended
            return False
        return True

    def close(self) -> None:
        """End the process; may be called twice."""
        self._process.kill()  # it holds nothing that has to be kept
        self._process.wait()
