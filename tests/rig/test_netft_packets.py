"""Bytes of RDT, by hand and at random."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.rig.devices.netft.packets import (
    PacketError,
    RdtCommand,
    SensorPacket,
    SensorStatus,
    packet_bytes,
    parse_packet,
    parse_request,
    request_bytes,
    status_meaning,
)

UNSIGNED = st.integers(0, 2**32 - 1)
SIGNED = st.integers(-(2**31), 2**31 - 1)
RECORDS = st.builds(SensorPacket, UNSIGNED, UNSIGNED, UNSIGNED, st.tuples(*[SIGNED] * 6))

KNOWN = SensorPacket(1, 7, 0x88000000, (1_500_000, -2_250_000, 1, -1, 2**31 - 1, -(2**31)))
KNOWN_BYTES = bytes.fromhex(
    "00000001 00000007 88000000"  # sequence, samplings, status
    "0016E360 FFDDAAF0 00000001"  # forces
    "FFFFFFFF 7FFFFFFF 80000000"  # torques
)


def test_a_start_without_end_is_these_eight_bytes():
    assert request_bytes(RdtCommand.START) == bytes.fromhex("12 34 00 02 00 00 00 00")


@pytest.mark.parametrize(
    ("command", "count", "written"),
    [
        (RdtCommand.STOP, 0, "1234 0000 00000000"),
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


def test_twenty_thousand_garbled_packets_raise_nothing_but_the_one_error():
    draw = random.Random(20)
    read = refused = 0
    for _ in range(20_000):
        packet = draw.randbytes(draw.choice([0, 1, 8, 35, 36, 36, 37, 72, 1400]))
        for parse in (parse_packet, parse_request):
            try:
                parse(packet)
                read += 1
            except PacketError:
                refused += 1
    assert read > 4_000  # 36 bytes are a record, whatever they say
    assert read + refused == 40_000


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
