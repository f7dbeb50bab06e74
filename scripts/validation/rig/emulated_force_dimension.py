"""Emulated Force Dimension device: a stand-in for libdrd, and the device itself in a process of its own.

    python -m scripts.validation.rig.emulated_force_dimension --build FOLDER
        compile the stand-in below FOLDER, which is then FDSDK
    python -m scripts.validation.rig.emulated_force_dimension --port 10002  be the device; prints its port

The stand-in has the functions that forcedimension_core looks for. Those that :mod:`cutenv.people.play.force_dimension`
calls exchange a force and a position with the device by UDP on this machine (``DHD_PORT``); the others fail. It is
written after the SDK's public reference; nothing of the SDK is in it. Compiled by ziglang, which is among the tools of
``dev``.
"""

from __future__ import annotations

import argparse
import importlib.util
import platform
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from cutenv.people.play.devices import simple_hand
from cutenv.people.play.inverse3_emulator import EmulatedHandle

_SOURCE = r"""
#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
static int plug = -1;
static double force[3], place[3];
static unsigned buttons;
static int fresh;
static int talk(void) {
    char answer[28];
    if (plug < 0 || send(plug, force, sizeof force, 0) < 0) return -1;
    if (recv(plug, answer, sizeof answer, 0) != sizeof answer) return -1;
    memcpy(place, answer, 24);
    memcpy(&buttons, answer + 24, 4);
    return 0;
}
int dhdGetSDKVersion(int *a, int *b, int *c, int *d) { *a = 3; *b = 17; *c = 0; *d = 0; return 0; }
int dhdOpen(void) {
    const char *port = getenv("DHD_PORT");
    struct sockaddr_in to = {.sin_family = AF_INET};
    struct timeval wait = {.tv_usec = 10000};
    if (!port) return -1;
    to.sin_port = htons(atoi(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    plug = socket(AF_INET, SOCK_DGRAM, 0);
    setsockopt(plug, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait);
    if (connect(plug, (struct sockaddr *)&to, sizeof to) < 0 || talk() < 0) return -1;
    return 0;
}
int dhdClose(char id) { (void)id; shutdown(plug, 2); plug = -1; return 0; }
int dhdEnableForce(_Bool on, char id) { (void)on; (void)id; return plug < 0 ? -1 : 0; }
int dhdSetForce(double x, double y, double z, char id) {
    (void)id; force[0] = x; force[1] = y; force[2] = z; fresh = talk(); return fresh;
}
int dhdGetPosition(double *x, double *y, double *z, char id) {
    (void)id; *x = place[0]; *y = place[1]; *z = place[2]; return fresh;
}
unsigned dhdGetButtonMask(char id) { (void)id; return buttons; }
int dhdErrorGetLast(void) { return 0; }
const char *dhdErrorGetLastStr(void) { return "emulated: no answer"; }
"""
_LETS_GO = 0.1  # [s] without a message
_PRESSED = (0.5, 0.8)  # [s] between which the first button is down


def build(folder: Path) -> Path:
    """Compile the stand-in where forcedimension_core looks below ``FDSDK=folder``; return its path (Linux only)."""
    found = importlib.util.find_spec("forcedimension_core")
    if found is None or found.origin is None:
        raise SystemExit("forcedimension_core is not installed: pip install 'cutenv[force-dimension]'")
    texts = [path.read_text(encoding="utf-8") for path in Path(found.origin).parent.rglob("*.py")]
    names = {name for text in texts for name in re.findall(r"_lib(?:dhd|drd)\.(\w+)", text)}
    defined = set(re.findall(r"\b(dhd\w+)\(", _SOURCE))
    stubs = "".join(f"int {name}(void) {{ return -1; }}\n" for name in sorted(names - defined))
    target = folder / f"lib/release/lin-{platform.machine()}-gcc/libdrd.so.3.17.0"
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as here:
        source = Path(here) / "libdrd.c"
        source.write_text(_SOURCE + stubs)
        subprocess.run(
            [sys.executable, "-m", "ziglang", "cc", "-shared", "-fPIC", "-O1", "-o", str(target), str(source)],
            check=True,
        )
    return target


def serve(port: int, target: float, wait: float, freeze: float | None) -> None:
    """Be the device until the process is ended; after ``freeze`` seconds it answers no more."""
    script = simple_hand(target)._script
    handle = EmulatedHandle(lambda now: script(max(now - wait, 0.0)).position)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plug:
        plug.bind(("127.0.0.1", port))
        plug.settimeout(_LETS_GO)
        print(plug.getsockname()[1], flush=True)
        start: float | None = None
        while True:
            try:
                message, sender = plug.recvfrom(64)
            except TimeoutError:
                handle.force = 0.0
                continue
            start = time.monotonic() if start is None else start
            now = time.monotonic() - start
            handle.advance(now)
            _, handle.force, _ = struct.unpack("=3d", message)
            if freeze is None or now < freeze:
                pressed = _PRESSED[0] <= now < _PRESSED[1]
                plug.sendto(struct.pack("=3dI", 0.0, handle.position, 0.0, pressed), sender)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, metavar="FOLDER", help="compile the stand-in below this folder")
    parser.add_argument("--port", type=int, default=10002, metavar="PORT", help="port of the device, 0 for any")
    parser.add_argument(
        "--target-mm", type=float, default=80.0, metavar="MM", help="target at which the hand aims [mm]"
    )
    parser.add_argument("--wait", type=float, default=4.0, metavar="S", help="rest of the hand at first [s]")
    parser.add_argument("--freeze", type=float, metavar="S", help="time after which the device is silent [s]")
    arguments = parser.parse_args()
    if arguments.build is not None:
        print(build(arguments.build))
    else:
        serve(arguments.port, 1e-3 * arguments.target_mm, arguments.wait, arguments.freeze)
