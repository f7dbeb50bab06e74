"""Print the attacks that a class's server is tested with: what happens, and the test that tries each.

python -m scripts.validation.classroom.class_attacks         the table, for scripts/update_docs.py class-attacks
python -m scripts.validation.classroom.class_attacks --try   run the tests
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

TESTS = Path("tests") / "people" / "classroom"
ATTACKS = (  # attack, what happens, and its test below TESTS
    ("readings that the law does not confirm", "refused, and the teacher sees it",
     "test_class_server.py::test_movements_that_the_law_does_not_confirm_are_refused_and_said_to_be"),
    ("a record sent twice", "refused", "test_class_server.py::test_a_record_cannot_be_sent_twice"),
    ("a record sent to two servers at once", "kept once",
     "test_class_faults.py::test_two_servers_on_one_folder_hand_out_and_keep_a_cut_once_up_to_the_last_task"),
    ("cuts begun at two servers at once, to get two",
     "both hand out the same: the database has one open cut of a person",
     "test_class_store.py::test_a_cut_is_handed_out_once_whatever_the_number_of_servers"),
    ("a cut begun, seen to go wrong and left, for the same specimen once more",
     "it counts as given up, cannot be sent any more, and the next specimen is another",
     "test_class_faults.py::test_a_cut_that_is_left_counts_as_given_up_and_the_next_specimen_is_another"),
    ("a cut of an easy course, finished in a hard one",
     "refused: it belongs to the course and task that it was handed out for",
     "test_class_faults.py::test_a_cut_of_another_course_is_neither_handed_out_again_nor_finished"),
    ("a computed cut, sent at once or never begun", "refused, and the teacher sees it",
     "test_class_faults.py::test_a_cut_that_was_not_begun_or_took_no_time_is_refused"),
    ("movements sent a second time, by the same person or another", "refused: no hand repeats them bit for bit",
     "test_class_faults.py::test_movements_that_were_seen_before_in_the_class_are_refused"),
    ("pauses, by a page that stands still", "time lost stands beside the cut",
     "test_class_faults.py::test_what_a_page_lost_is_shown"),
    ("another person's cut", "not found", "test_class_server.py::test_somebody_elses_cut_is_not_there"),
    ("another person's data, or the teacher's pages, as a trainee or as nobody", "sign in first",
     "test_class_server.py::test_nobody_gets_in_without_signing_in"),
    ("injection into SQL or page by the code", "a wrong code",
     "test_class_server.py::test_injection_into_sql_and_page_is_just_a_wrong_code"),
    ("paths that lead out of the folder", "not found: no path of a client is opened",
     "test_class_server.py::test_no_path_of_a_client_is_opened"),
    ("a backup with paths that lead out, as names or in its rows", "refused, nothing is written",
     "test_class_store.py::test_what_is_no_backup_is_refused_and_nothing_written"),
    ("guessing codes", "after 10 failures and 2 for each code, wait for a minute; the teacher is let in",
     "test_class_server.py::test_guessing_codes_is_slowed_down_and_neither_a_class_nor_its_teacher_is_locked_out"),
    ("the next person at a shared computer", "signed out after 15 minutes; the code stands above, with a button",
     "test_class_server.py::test_who_was_not_seen_for_long_is_signed_out_and_a_teacher_stays"),
    ("a teacher's cookie after the server was started again", "signed out; one button signs out everywhere",
     "test_class_server.py::test_the_teacher_is_signed_out_everywhere_by_one_button_and_by_another_token"),
    ("another site whose name leads to this machine", "refused: the server answers to its own names",
     "test_class_server.py::test_a_name_that_is_not_the_servers_reads_nothing"),
    ("guessing the token under made-up addresses (X-Forwarded-For), over TLS", "after 10 failures, wait for a minute",
     "test_class_faults.py::test_a_certificate_encrypts_and_guesses_are_slowed_down_whatever_they_call_themselves"),
    ("guessing from many addresses, to fill the memory", "10,000 addresses are remembered",
     "test_class_faults.py::test_whoever_fails_from_many_addresses_fills_no_memory"),
    ("a made-up cookie", "signed out", "test_class_server.py::test_a_made_up_cookie_is_nobodys"),
    ("the address of a double click, used a second time", "sign in first",
     "test_desktop_shortcut.py::test_a_double_click_serves_the_class_and_opens_the_teachers_page_signed_in"),
    ("a request from another site", "refused: same-site cookies, origin check",
     "test_class_server.py::test_another_site_cannot_act_for_a_person"),
    ("a page in a frame, a script from elsewhere", "forbidden by the content security policy",
     "test_class_server.py::test_every_page_forbids_what_it_does_not_need"),
    ("a request of many megabytes", "refused before it is read",
     "test_class_server.py::test_a_huge_request_is_refused_before_it_is_read"),
    ("a teacher's upload from 16 MB on", "refused before it is read",
     "test_teacher_pages.py::test_only_an_upload_may_be_large_and_it_has_its_limit"),
    ("an upload that is no text, has endless lines or columns, or a path as its name",
     "refused with the reason; no name of a client is opened",
     "test_teacher_pages.py::test_what_is_no_record_is_refused_with_the_reason"),
    ("an upload that poses as a confirmed cut of a course", "what it claims is taken out; it counts for no course",
     "test_teacher_pages.py::test_an_own_record_needs_no_columns_and_cannot_pose_as_a_confirmed_one"),
    ("hundreds of connections that say nothing, or half a header",
     "closed after 10 s, and at most 128 of one address wait; others are answered",
     "test_class_faults.py::test_connections_that_say_nothing_shut_nobody_out"),
    ("malformed messages", "an error of the client's, nothing is stored",
     "test_class_faults.py::test_malformed_messages_store_nothing_and_break_nothing"),
    ("commands to a rig that is watched", "there is nothing that takes them",
     "test_live_rig.py::test_the_teacher_alone_may_watch_and_nobody_can_send"),
    ("made-up readings of a rig", "dropped, unless another program of the same machine sends well-formed ones",
     "test_live_rig.py::test_what_is_no_reading_is_dropped"),
    ("a launch from a learning platform that is too old, or meant for another tool or deployment",
     "refused with the reason", "test_lti.py::test_a_launch_that_is_not_sound_lets_nobody_in"),
    ("a launch that is unsigned, signed by another key, or by a public key as if it were a secret",
     "refused with the reason", "test_lti.py::test_a_token_of_another_kind_or_key_lets_nobody_in"),
    ("a launch sent a second time", "refused, also after a restart",
     "test_lti.py::test_a_launch_is_used_once_even_by_the_browser_that_began_it"),
    ("a launch sent by another browser than the one that began it", "refused",
     "test_lti.py::test_another_browser_and_another_state_let_nobody_in"),
    ("a form of another site that launches, agrees or registers a platform",
     "refused: what takes such forms changes nothing", "test_lti.py::test_a_form_of_another_site_signs_nobody_in"),
    ("launches under made-up keys, to make the class ask a platform without end",
     "it is asked every ten seconds at most", "test_lti.py::test_a_platform_may_change_its_keys_and_is_asked_seldom"),
    ("an instructor of any other course of the platform, who wants the teacher's pages",
     "refused: courses are named one by one",
     "test_lti.py::test_an_instructor_is_let_into_the_teachers_pages_of_a_course_that_was_named_alone"),
    ("a platform's list of members that is of another course, or leads to another server for its next page",
     "not shown, and the token is not sent there",
     "test_lti_members.py::test_pages_in_a_circle_and_to_another_server_end"),
    ("a platform that registers without the teacher's address, with an old one, or with one a second time",
     "refused, and it is not asked",
     "test_lti_registration.py::test_nobody_registers_without_an_address_that_the_teacher_made_within_an_hour"),
    ("a registration that speaks for another platform, or leads to another server or this machine",
     "refused, and no token is sent there",
     "test_lti_registration.py::test_a_platform_that_does_not_describe_itself_soundly_is_not_registered"),
    ("a record of another program, for a grade", "no grade: cuts that the server computed count alone",
     "test_lti.py::test_no_record_of_another_program_and_no_other_course_is_a_grade"),
    ("a learning record store that sends statements on to elsewhere", "not followed",
     "test_xapi_statements.py::test_a_store_that_fails_is_asked_again_and_gets_every_statement_once"),
)  # fmt: skip


def markdown() -> str:
    """Return the table for the documentation."""
    rows = [f"| {attack} | {outcome} | `{test.partition('::')[0]}` |" for attack, outcome, test in ATTACKS]
    return "\n".join(("| attack | what happens | tried in `tests/people/classroom` |", "|---|---|---|", *rows))


def main() -> int:
    """Print the table, or run its tests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--try", action="store_true", dest="tried", help="run the tests")
    if parser.parse_args().tried:
        tests = [str(TESTS / test) for _, _, test in ATTACKS]
        return subprocess.run([sys.executable, "-m", "pytest", "-q", *tests], check=False).returncode
    print(markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
