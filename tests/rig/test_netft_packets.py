"""Bytes of RDT, by hand and at random; the sensor's page: units into SI, nothing assumed, and no page that harms."""

from __future__ import annotations

import contextlib
import http.server
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.emulation.sensor_server import SensorPage, SensorServer
from cutenv.rig.devices.netft_sensor import (
    MAX_PAGE_BYTES,
    PacketError,
    RdtCommand,
    SensorPacket,
    SensorStatus,
    packet_bytes,
    parse_packet,
    parse_page,
    parse_request,
    read_page,
    request_bytes,
    status_meaning,
)
from cutenv.rig.errors import RigError

UNSIGNED = st.integers(0, 2**32 - 1)
SIGNED = st.integers(-(2**31), 2**31 - 1)
RECORDS = st.builds(SensorPacket, UNSIGNED, UNSIGNED, UNSIGNED, st.tuples(*[SIGNED] * 6))

KNOWN = SensorPacket(1, 7, 0x88000000, (1_500_000, -2_250_000, 1, -1, 2**31 - 1, -(2**31)))
KNOWN_BYTES = bytes.fromhex(
    "00000001 00000007 88000000"  # sequence, samplings, status
    "0016E360 FFDDAAF0 00000001"  # forces
    "FFFFFFFF 7FFFFFFF 80000000"  # torques
)


@pytest.mark.parametrize(
    ("command", "count", "written"),
    [
        (RdtCommand.STOP, 0, "1234 0000 00000000"),
        (RdtCommand.START, 0, "1234 0002 00000000"),  # without end
        (RdtCommand.START, 258, "1234 0002 00000102"),
        (RdtCommand.RESET_LATCH, 0, "1234 0041 00000000"),
        (RdtCommand.BIAS, 0, "1234 0042 00000000"),
    ],
)
def test_each_command_is_written_and_read_as_in_the_manual(command, count, written):
    assert request_bytes(command, count) == bytes.fromhex(written)
    assert parse_request(bytes.fromhex(written)) == (command, count)


def test_a_known_record_is_written_and_read_byte_by_byte():
    assert packet_bytes(KNOWN) == KNOWN_BYTES
    assert parse_packet(KNOWN_BYTES) == KNOWN


@given(RECORDS)
def test_a_record_comes_back_as_it_went(record):
    packet = packet_bytes(record)
    assert len(packet) == 36
    assert parse_packet(packet) == record


@given(st.sampled_from(RdtCommand), UNSIGNED)
def test_a_request_comes_back_as_it_went(command, count):
    assert parse_request(request_bytes(command, count)) == (command, count)


@given(st.binary(max_size=80))
def test_whatever_comes_is_a_record_or_the_one_error(packet):
    if len(packet) == 36:
        assert packet_bytes(parse_packet(packet)) == packet
    else:
        with pytest.raises(PacketError, match=f"36 bytes, this has {len(packet)}"):
            parse_packet(packet)
    with contextlib.suppress(PacketError):
        assert request_bytes(*parse_request(packet)) == packet


@pytest.mark.parametrize(
    ("packet", "why"),
    [
        ("1234 0002 000000", "8 bytes, this has 7"),
        ("4321 0002 00000000", "begins with 0x1234, this with 0x4321"),
        ("1234 0099 00000000", "0x0099 is not known"),
    ],
)
def test_a_request_that_is_none_is_refused_with_the_reason(packet, why):
    with pytest.raises(PacketError, match=why):
        parse_request(bytes.fromhex(packet))


def test_numbers_that_do_not_fit_are_refused():
    with pytest.raises(PacketError, match="does not fit"):
        packet_bytes(KNOWN._replace(sequence=2**32))
    with pytest.raises(ValueError, match="count"):
        request_bytes(RdtCommand.START, 2**32)


def test_a_status_is_told_in_words():
    assert status_meaning(0) == "healthy"
    assert (
        status_meaning(SensorStatus.ERROR | SensorStatus.GAGE_OUT_OF_RANGE)
        == "0x88000000: error, strain gage out of range"
    )
    assert status_meaning(1 << 31 | 1 << 17) == "0x80020000: error, bits 17 (see the sensor's manual)"


PAGE = (
    "<?xml version='1.0'?><netft><cfgcpf>{cpf}</cfgcpf><cfgcpt>{cpt}</cfgcpt>"
    "<scfgfu>{force}</scfgfu><scfgtu>{torque}</scfgtu>{more}</netft>"
)


def page(cpf="1000000", cpt="1000000", force="N", torque="Nm", more=""):
    return PAGE.format(cpf=cpf, cpt=cpt, force=force, torque=torque, more=more).encode()


@pytest.fixture
def web():
    """Return how to serve an answer; it gets the handler of the request."""
    servers = []

    def serve(answer):
        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                answer(self)

            def log_message(self, format, *args):
                pass

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_address[1]}/netftapi2.xml"

    yield serve
    for server in servers:
        server.shutdown()
        server.server_close()


def answering(text):
    def answer(handler):
        handler.send_response(200)
        handler.end_headers()
        handler.wfile.write(text)

    return answer


FORCES = {"N": 1.0, "kN": 1000.0, "lbf": 4.448222, "klbf": 4448.222, "kg": 9.80665, "kgf": 9.80665, "g": 0.00980665}
TORQUES = {"N-m": 1.0, "Nm": 1.0, "N-mm": 1e-3, "kN-m": 1000.0, "lbf-in": 0.1129848, "lbf-ft": 1.355818,
           "kgf-cm": 0.0980665, "kg-cm": 0.0980665}  # fmt: skip


def test_forces_and_torques_of_every_unit_become_newtons_and_newton_metres():
    for unit, newtons in FORCES.items():
        assert parse_page(page(cpf="500", force=unit)).newtons_per_count == pytest.approx(newtons / 500, rel=1e-6), unit
    for unit, metres in TORQUES.items():
        found = parse_page(page(cpt="250", torque=unit))
        assert found.newton_metres_per_count == pytest.approx(metres / 250, rel=1e-6), unit


def test_the_rate_is_what_the_page_says_and_none_where_it_says_nothing():
    assert parse_page(page(more="<comrdtrate>7000</comrdtrate>")).rate == 7000.0
    assert parse_page(page()).rate is None


def test_a_page_in_another_encoding_or_with_a_namespace_is_read():
    text = page().decode().replace("<netft>", '<netft xmlns="http://example.org/netft">')
    assert parse_page(text.encode("utf-16")).newtons_per_count == 1e-6


def test_what_is_missing_is_named_and_nothing_assumed_for_it():
    with pytest.raises(RigError, match=r"lacks cfgcpf \(counts per force\), scfgtu \(unit of torque\)"):
        parse_page(b"<netft><cfgcpt>1000</cfgcpt><scfgfu>N</scfgfu><scfgtu> </scfgtu></netft>")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        *((page(cpf=counts), f"cfgcpf = '{counts}'") for counts in ("0", "-1", "nan", "inf", "1e-300", "many")),
        (page(force="stone"), "scfgfu = 'stone', a unit that is not known"),
        (page(torque="lbf-furlong"), "scfgtu = 'lbf-furlong', a unit that is not known"),
        *((text, "is not XML") for text in (b"", b"<netft>", b"\x00\xff", b"<html><br></html>")),
        (b"<?xml version='1.0' encoding='x-no'?><a/>", "is not XML"),
    ],
)
def test_counts_units_and_texts_that_are_none_are_refused(text, why):
    with pytest.raises(RigError, match=why):
        parse_page(text)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(
    "declared",
    [
        '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;&x;&x;&x;&x;&x;">]>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">',
    ],
)
def test_entities_are_refused_before_they_are_read(declared, encoding):
    with pytest.raises(RigError, match="document type"):
        parse_page(f"{declared}<a>&x;</a>".encode(encoding))


def test_a_page_is_fetched_from_where_it_is(web):
    assert read_page(web(answering(page(cpf="2000")))).newtons_per_count == pytest.approx(1 / 2000)


def test_the_emulated_sensor_shows_a_page_that_is_read():
    with SensorServer(
        configuration=SensorPage(counts_per_newton=2000, counts_per_newton_metre=30_000, rate=500.0)
    ) as server:
        found = read_page(server.page)
    assert (found.newtons_per_count, found.newton_metres_per_count, found.rate) == (1 / 2000, 1 / 30_000, 500.0)


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (answering(b"<netft>" + b" " * MAX_PAGE_BYTES), f"more than {MAX_PAGE_BYTES} bytes"),
        (lambda handler: handler.send_error(404), "404"),
    ],
)
def test_a_page_that_is_too_large_or_says_no_is_refused(web, answer, why):
    with pytest.raises(RigError, match=why):
        read_page(web(answer))


def test_a_page_elsewhere_is_not_followed(web):
    def redirect(handler):
        handler.send_response(302)
        handler.send_header("Location", elsewhere)
        handler.end_headers()

    elsewhere = web(answering(page()))
    with pytest.raises(RigError, match="302"):
        read_page(web(redirect))


def test_a_page_that_comes_in_drops_ends_with_the_time_limit(web):
    def drip(handler):
        handler.send_response(200)
        handler.end_headers()
        for _ in range(100):  # each byte in time, the whole not
            handler.wfile.write(b" ")
            handler.wfile.flush()
            time.sleep(0.05)

    address = web(drip)
    begun = time.monotonic()
    with pytest.raises(RigError, match=r"within 0\.3 s"):
        read_page(address, timeout=0.3)
    assert time.monotonic() - begun < 3.0  # time is the promise: five seconds of drops


def test_where_nobody_answers_the_error_says_what_to_check():
    with SensorServer() as server:
        page_that_was = server.page
    with pytest.raises(RigError, match=r"powered and on this network.*sensor\.address"):
        read_page(page_that_was)


@pytest.mark.parametrize(
    ("address", "why"),
    [
        *(
            (address, "must begin with http://")
            for address in ("file:///etc/passwd", "ftp://127.0.0.1/a", "10.0.0.1", "")
        ),
        *((f"http://{rest}", "cannot be read") for rest in ("", ":x", "[::1", "a b/", "\u0000")),
    ],
)
def test_an_address_that_is_none_or_not_of_http_is_a_readable_error(address, why):
    with pytest.raises(RigError, match=why):
        read_page(address)
