"""The emulated rig as a process: it starts, answers strangers, counts its own delays, and leaves nothing behind."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing

import can
import canopen
import pytest
from waiting import until

from cutenv.commands.cli import main
from cutenv.emulation.control_port import EmulatorControl
from cutenv.emulation.process import RunningEmulator, start
from cutenv.rig.errors import RigError

PATIENCE = 10.0  # [s], far beyond what is needed


@pytest.fixture(scope="module")
def emulator() -> Iterator[RunningEmulator]:
    with start(seed=3, real_time=False) as running:
        yield running


def ended(pid: int) -> bool:
    """Whether it is gone; one that nobody has waited for counts as gone."""
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_its_settings_are_those_of_an_emulated_rig(emulator):
    settings = emulator.settings
    assert settings.emulated
    assert settings.bus.host == settings.sensor.address == "127.0.0.1"
    assert settings.angle_mode == "free"
    assert settings.depth_profile == ()


def test_the_sensor_streams_at_a_thousand_hertz(emulator):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(PATIENCE)
        client.sendto(struct.pack("!HHI", 0x1234, 2, 1000), ("127.0.0.1", emulator.settings.sensor.port))
        sequences = [struct.unpack_from("!I", client.recv(64))[0]]
        began = time.monotonic()
        sequences += [struct.unpack_from("!I", client.recv(64))[0] for _ in range(999)]
        took = time.monotonic() - began
    assert sequences == list(range(sequences[0], sequences[0] + 1000))
    assert 0.7 < took < 3.0  # a busy machine sends late, never less


def test_a_foreign_master_sets_it_up_and_moves_it(emulator):
    """canopen's remote node, its object dictionary made here: nothing of the rig's own master."""
    dictionary = canopen.ObjectDictionary()
    kinds = canopen.objectdictionary.datatypes
    for index, name, kind in (
        (0x1000, "device type", kinds.UNSIGNED32), (0x1008, "device name", kinds.VISIBLE_STRING),
        (0x6040, "controlword", kinds.UNSIGNED16), (0x6041, "statusword", kinds.UNSIGNED16),
        (0x6060, "mode", kinds.INTEGER8), (0x6064, "position", kinds.INTEGER32),
        (0x60FF, "target velocity", kinds.INTEGER32),
    ):  # fmt: skip
        variable = canopen.objectdictionary.ODVariable(name, index)
        variable.data_type = kind
        dictionary.add_object(variable)
    network = canopen.Network(
        can.Bus(interface="socketcand", channel="vcan0", host="127.0.0.1", port=emulator.settings.bus.port)
    )
    network.connect()
    try:
        node = network.add_node(1, dictionary)
        assert node.sdo[0x1000].raw == 0x00020192
        assert node.sdo[0x1008].raw == "EPOS4"
        node.sdo[0x6060].raw = 3
        for word in (0x06, 0x07, 0x0F):
            node.sdo[0x6040].raw = word
        assert node.sdo[0x6041].raw & 0x6F == 0x27
        before = emulator.control.truth()["position_m"]
        node.sdo[0x60FF].raw = 1320  # rpm
        until(lambda: emulator.control.truth()["position_m"] > before + 0.002)
        node.sdo[0x60FF].raw = -1320
        until(lambda: emulator.control.truth()["position_m"] < before + 0.001)
        node.sdo[0x6040].raw = 0x0B
        until(lambda: abs(emulator.control.truth()["speed_m_s"]) < 1e-5)
        node.sdo[0x6040].raw = 0x00
        with pytest.raises(canopen.SdoAbortedError, match="0x06010002"):
            node.sdo[0x6041].raw = 0
    finally:
        network.disconnect()
    told = [event["what"] for event in emulator.control.events()]
    assert {"quick stop received", "standstill"} <= set(told)


def test_a_specimen_is_laid_at_the_clamp_and_named(emulator):
    truth = emulator.control.truth()
    assert truth["specimen"] == {"seed": 3, "episode": 0, "class": "liver"}
    other = EmulatorControl(emulator.control.port)
    other.specimen(seed=5, episode=2, specimen_class="vascular")
    assert emulator.control.truth()["specimen"] == {"seed": 5, "episode": 2, "class": "vascular"}
    emulator.control.free_air()
    assert emulator.control.truth()["specimen"] is None


def test_what_it_refuses_it_refuses_with_the_cure(emulator):
    control = emulator.control
    with pytest.raises(RigError, match="Did you mean 'events'"):
        control.ask("event")
    with pytest.raises(RigError, match="class"):
        control.specimen(specimen_class="steel")
    with pytest.raises(RigError, match="takes no field 'sede'"):
        control.ask("specimen", sede=3)
    with pytest.raises(RigError, match="seed"):
        control.specimen(seed=-1)
    with pytest.raises(RigError, match="it has: axis"):
        control.inject("bus_off", on="blade")
    with pytest.raises(RigError, match="nowhere"):
        control.specimen(tissue="nowhere.json")


def test_faults_come_and_go_by_the_control_port(emulator):
    since = len(emulator.control.events())
    emulator.control.inject("packet_loss", share=0.25)
    assert {"fault": "packet_loss", "share": 0.25} in emulator.control.state()["faults"]
    assert emulator.control.clear() == ["packet_loss"]
    assert emulator.control.state()["faults"] == []
    events = emulator.control.events(since)
    told = {event["what"]: event["time_s"] for event in events}
    assert told["fault injected"] <= told["fault cleared"] <= time.monotonic()


def test_garbage_at_the_control_port_harms_nobody(emulator):
    generator, lines = random.Random(1), 0
    while lines < 2_000:
        with socket.create_connection(("127.0.0.1", emulator.control.port), timeout=PATIENCE) as connection:
            try:
                for _ in range(200):
                    connection.sendall(generator.randbytes(generator.randrange(1, 200)) + b"\n")
                    lines += 1
                while connection.recv(4096):
                    continue
            except OSError:
                continue  # hung up on, as it should be
    assert emulator.control.state()["nodes"][0]["axis"] == "blade"


@pytest.mark.parametrize("line", [b"[]", b"3", b"null", b'{"do": []}', b'{"do": {"a": 1}}', b'{"do": "watch"}', b"{}"])
def test_json_that_is_no_request_is_answered_and_the_talk_goes_on(emulator, line):
    with socket.create_connection(("127.0.0.1", emulator.control.port), timeout=PATIENCE) as connection:
        lines = connection.makefile("rb")
        connection.sendall(line + b"\n")
        assert json.loads(lines.readline())["ok"] is False
        connection.sendall(b'{"do": "state"}\n')
        assert json.loads(lines.readline())["ok"] is True
        lines.close()


def test_its_own_delays_are_counted(emulator):
    """It waits for a stall as long as the pause: a busy host adds short ones of its own, before and after."""
    before = emulator.control.state()["stalls"]
    os.kill(emulator.pid, signal.SIGSTOP)
    time.sleep(0.1)
    os.kill(emulator.pid, signal.SIGCONT)
    state = until(lambda: (found := emulator.control.state())["worst_stall_s"] > 0.05 and found)
    assert state["stalls"] > before
    assert "stall" in [event["what"] for event in emulator.control.events()]


def test_the_crossing_of_the_force_that_is_watched_is_told(emulator):
    control = emulator.control
    since = len(control.events())
    control.watch(7.0)
    try:
        control.inject("over_force", force_N=6.0)
        control.clear("over_force")
        control.inject("over_force", force_N=8.0)
        until(lambda: "force limit crossed" in [event["what"] for event in control.events(since)])
    finally:
        control.clear()
        control.watch(15.0)
    crossings = [event for event in control.events(since) if event["what"] == "force limit crossed"]
    assert [event["force_N"] > 7.0 for event in crossings] == [True]


@pytest.mark.parametrize("way", ["shutdown", "terminate", "interrupt"])
def test_it_ends_in_each_way_with_status_0(way):
    with closing(start(real_time=False, free_air=True, angle_deg=60.0, arguments=["--fault", "bus_off@0"])) as running:
        assert running.settings.angle is None
        until(lambda: running.control.state()["faults"] == [{"fault": "bus_off", "axis": "blade"}])
        if way == "shutdown":
            running.control.shutdown()
        else:
            os.kill(running.pid, signal.SIGTERM if way == "terminate" else signal.SIGINT)
        until(lambda: ended(running.pid))
        with pytest.raises(RigError, match=r"start it again|still running"):
            running.control.ask("state")
    assert running.status == 0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", running.settings.bus.port), timeout=1.0)


def test_it_ends_with_its_parent():
    script = (
        "import os, time; from cutenv.emulation.process import start\n"
        "running = start(real_time=False); print(running.pid, flush=True); os._exit(1)"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=200)
    assert ran.returncode == 1
    until(lambda: ended(int(ran.stdout)))


def test_a_bad_option_is_refused_before_it_is_ready(capfd):
    with pytest.raises(RigError, match="ended before it was ready"):
        start(arguments=["--fault", "earthquake@1"])
    assert "fault must be one of" in capfd.readouterr().err
    assert main(["rig", "emulate", "--angle", "fixed", "--angle-deg", "30"]) == 2
    assert "45 to 90 degrees" in capfd.readouterr().err


def test_nobody_at_the_control_port_is_said_with_the_cure():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(RigError, match="cutenv rig emulate"):
        EmulatorControl(port, timeout=1.0)
