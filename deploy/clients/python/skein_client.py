#!/usr/bin/env python3
"""A client of a Skein fleet: reads live estimates, decodes exchanges, feeds drivers. A library and a small program.

Decoding needs Python alone (`struct`); talking to a fleet needs eclipse-zenoh, see ../requirements.txt. As a program:

    skein_client.py get [VEHICLE] --connect tcp/127.0.0.1:7447      the newest estimate of one vehicle, or of all
    skein_client.py listen --connect tcp/127.0.0.1:7447             exchanges as they pass, decoded
    skein_client.py drive VEHICLE --connect tcp/127.0.0.1:7447      frames from standard input into the vehicle's drivers
    skein_client.py decode                                          packets in hexadecimal from standard input

All of them print one JSON object a line. `drive` reads lines `{"sensor": "odometry", "frame": {...}}`, the form of
Skein's recordings; the sensor must be configured with `driver = "zenoh"`. Times are nanoseconds of UNIX time.
"""

import argparse
import contextlib
import json
import struct
import sys
import threading
import time
from collections import deque
from dataclasses import asdict, dataclass

VERSION_MAJOR = 1
VERSION_MINOR = 1
VERSION_CHUNK = "@v1"
ENVELOPE = struct.Struct("<BBHIQQq")
MEASURED_MAX = 3
STATUSES = ["unplaced", "tracking", "degraded", "dead_reckoning", "alone", "resuming", "lost"]
# Each kind with its fields and how many numbers they hold: counts of doubles first, standard deviations are floats.
KINDS = [
    ("pose", [("body_from_neighbour", 6)], ["rotation_sigma_rad", "translation_sigma_m"]),
    ("orientation", [("rotation_vector_rad", 3)], ["sigma_rad"]),
    ("position", [("position_m", 3)], ["sigma_m"]),
    ("bearing", [("direction", 3), ("origin_m", 3)], ["sigma_rad"]),
    ("distance", [("distance_m", 1), ("origin_m", 3)], ["sigma_m"]),
]
# Pause between two tries while a fleet is being discovered.
RETRY_S = 0.1


class DecodeError(ValueError):
    """Bytes that are no packet of this version."""


class NobodyAnswered(TimeoutError):
    """No vehicle answered in time."""


@dataclass
class Envelope:
    """What every packet opens with. Times are nanoseconds of the sender's clock."""

    major: int
    minor: int
    body_bytes: int
    sequence: int
    boot: int
    sender: int
    taken_ns: int


@dataclass
class Exchange:
    """One vehicle's prior of one round, and what it measured of the addressee.

    `prior` is `world_from_body`: rotation vector (rad), then translation (m). Each entry of `measured` has its `kind`,
    `taken_offset_us` (after the round's instant), and the numbers of that kind in the sender's body frame.
    """

    sent_ns: int
    status: str
    echo: dict | None
    prior: list[float] | None
    measured: list[dict]


class _Reader:
    """Takes little-endian values from the front of some bytes."""

    def __init__(self, data):
        self.data = data
        self.at = 0

    def take(self, layout):
        layout = struct.Struct("<" + layout)
        if self.at + layout.size > len(self.data):
            raise DecodeError(f"cut short at byte {len(self.data)}")
        values = layout.unpack_from(self.data, self.at)
        self.at += layout.size
        return values

    def one(self, layout):
        return self.take(layout)[0]

    def is_present(self):
        """The tag of an optional field."""
        tag = self.one("B")
        if tag > 1:
            raise DecodeError(f"byte {self.at - 1} is {tag}, not 0 (absent) or 1 (present)")
        return tag == 1


def name_hash(name):
    """The 64 bits by which packets name a vehicle: FNV-1a of its name."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def decode_exchange(packet):
    """The envelope and the exchange in a packet of `{fleet}/@v1/{from}/x/exchange/{to}`."""
    if len(packet) < ENVELOPE.size:
        raise DecodeError(f"{len(packet)} bytes are no envelope")
    envelope = Envelope(*ENVELOPE.unpack_from(packet))
    if envelope.major != VERSION_MAJOR:
        raise DecodeError(f"version {envelope.major}.{envelope.minor}, this client reads {VERSION_MAJOR}.x")
    body = packet[ENVELOPE.size :]
    if len(body) != envelope.body_bytes:
        raise DecodeError(f"a body of {len(body)} bytes, {envelope.body_bytes} were announced")
    reader = _Reader(body)
    sent_ns, status = reader.take("qB")
    echo = dict(zip(("heard_ns", "received_ns"), reader.take("qq"))) if reader.is_present() else None
    prior = list(reader.take("6d")) if reader.is_present() else None
    # A list opens with its length; one byte, as it is below 128.
    count = reader.one("B")
    if count > MEASURED_MAX:
        raise DecodeError(f"{count} measurements, at most {MEASURED_MAX}")
    measured = [_measured(reader) for _ in range(count)]
    if reader.at < len(body) and envelope.minor <= VERSION_MINOR:
        raise DecodeError(f"{len(body) - reader.at} bytes too many")
    status = STATUSES[status] if status < len(STATUSES) else f"code {status}"
    return envelope, Exchange(sent_ns, status, echo, prior, measured)


def _measured(reader):
    taken_offset_us, tag = reader.take("iB")
    if tag >= len(KINDS):
        raise DecodeError(f"there is no kind {tag} of measurement")
    kind, fields, deviations = KINDS[tag]
    measured = {"taken_offset_us": taken_offset_us, "kind": kind}
    for field, count in fields:
        values = reader.take(f"{count}d")
        measured[field] = values[0] if count == 1 else list(values)
    for field in deviations:
        measured[field] = reader.one("f")
    return measured


class Client:
    """A session with a fleet. Use it in a `with` statement, or close it."""

    def __init__(self, fleet="skein", connect=(), listen=(), multicast=True):
        import zenoh

        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", json.dumps(list(connect)))
        config.insert_json5("scouting/multicast/enabled", json.dumps(multicast))
        if listen:
            config.insert_json5("listen/endpoints", json.dumps(list(listen)))
        self.fleet = fleet
        self.session = zenoh.open(config)
        self._publishers = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends the session."""
        self.session.close()

    def key(self, *chunks):
        """A key of the fleet."""
        return "/".join([self.fleet, VERSION_CHUNK, *chunks])

    def vehicles(self, wait_s=5.0):
        """The vehicles that are present, by their liveliness tokens; waits for the first, then for its neighbours."""
        deadline = time.monotonic() + wait_s
        seen = set()
        while True:
            replies = self.session.liveliness().get(self.key("*", "@alive", "*"), timeout=1.0)
            now_seen = {str(reply.ok.key_expr).split("/")[2] for reply in replies if reply.ok}
            settled = bool(now_seen) and now_seen == seen
            if settled or time.monotonic() > deadline:
                return sorted(now_seen)
            seen = now_seen
            time.sleep(5 * RETRY_S)

    def document(self, vehicle, topic, wait_s=5.0):
        """A JSON document of a vehicle, `state/estimate`, `state/health` or `info`, as a dictionary.

        A query that nobody can answer yet returns at once, so it is repeated until somebody does.
        """
        deadline = time.monotonic() + wait_s
        reason = "no reply"
        while True:
            for reply in self.session.get(self.key(vehicle, topic), timeout=1.0):
                if reply.ok:
                    return json.loads(reply.ok.payload.to_bytes())
                reason = reply.err.payload.to_string()
            if time.monotonic() > deadline:
                raise NobodyAnswered(f"{vehicle} within {wait_s} s: {reason}")
            time.sleep(RETRY_S)

    def estimate(self, vehicle, wait_s=5.0):
        """The newest estimate of a vehicle."""
        return self.document(vehicle, "state/estimate", wait_s)

    def listen(self, take):
        """Calls `take(key, packet)` with every exchange that passes, until the client is closed.

        `take` runs on a thread of Zenoh: it should only put the packet aside.
        """

        def callback(sample):
            take(str(sample.key_expr), sample.payload.to_bytes())

        return self.session.declare_subscriber(self.key("*", "x", "exchange", "*"), callback)

    def drive(self, vehicle, sensor, frame, wait_s=5.0):
        """Sends one frame, a dictionary in the JSON form, to a sensor of a vehicle whose driver is `zenoh`.

        The first frame of a sensor waits until the vehicle listens: what is sent before is heard by nobody.
        """
        key = self.key(vehicle, "@driver", sensor)
        if key not in self._publishers:
            self._publishers[key] = self._publisher(key, wait_s)
        self._publishers[key].put(json.dumps(frame))

    def _publisher(self, key, wait_s):
        publisher = self.session.declare_publisher(key, express=True)
        deadline = time.monotonic() + wait_s
        while not publisher.matching_status.matching:
            if time.monotonic() > deadline:
                raise NobodyAnswered(f'nobody listens on {key}: is the sensor configured with driver = "zenoh"?')
            time.sleep(RETRY_S)
        return publisher


def _print(value):
    print(json.dumps(value), flush=True)


def _get(client, arguments):
    vehicles = [arguments.vehicle] if arguments.vehicle else client.vehicles(arguments.wait)
    if not vehicles:
        raise NobodyAnswered(f"no vehicle of fleet {arguments.fleet} within {arguments.wait} s")
    for vehicle in vehicles:
        _print(client.estimate(vehicle, arguments.wait))


def _listen(client, arguments):
    packets, arrived = deque(), threading.Event()

    def take(key, packet):
        packets.append((key, packet))
        arrived.set()

    subscriber = client.listen(take)
    heard = 0
    while arguments.count is None or heard < arguments.count:
        # The wait is for the next one: a listener of a quiet fleet says so instead of hanging.
        if not packets and not arrived.wait(arguments.wait):
            raise NobodyAnswered(f"no exchange of fleet {arguments.fleet} within {arguments.wait} s")
        arrived.clear()
        while packets and heard != arguments.count:
            key, packet = packets.popleft()
            _print({"key": key, "packet": packet.hex(), **_decoded(packet, sender=key.split("/")[2])})
            heard += 1
    subscriber.undeclare()


def _drive(client, arguments):
    for line in sys.stdin:
        if line.strip():
            entry = json.loads(line)
            client.drive(arguments.vehicle, entry["sensor"], entry["frame"], arguments.wait)


def _decoded(packet, sender=None):
    try:
        envelope, exchange = decode_exchange(packet)
        if sender is not None and envelope.sender != name_hash(sender):
            raise DecodeError(f"the packet is not from {sender}, under whose key it came")
    except DecodeError as error:
        return {"error": str(error)}
    return {"envelope": asdict(envelope), "exchange": asdict(exchange)}


def _arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    fleet = argparse.ArgumentParser(add_help=False)
    fleet.add_argument("--fleet", default="skein", help="the fleet, skein unless given")
    fleet.add_argument("--connect", action="append", default=[], metavar="ENDPOINT", help="an endpoint of any vehicle")
    fleet.add_argument("--listen", action="append", default=[], metavar="ENDPOINT", help="where to be dialled")
    fleet.add_argument("--no-multicast", action="store_true", help="do not look for vehicles by multicast")
    fleet.add_argument("--wait", type=float, default=5.0, metavar="SECONDS", help="how long to wait for the fleet")
    get = commands.add_parser("get", parents=[fleet], help="the newest estimate of one vehicle, or of all")
    get.add_argument("vehicle", nargs="?")
    listen = commands.add_parser("listen", parents=[fleet], help="exchanges as they pass, decoded")
    listen.add_argument("--count", type=int, help="end after so many")
    drive = commands.add_parser("drive", parents=[fleet], help="frames from standard input into a vehicle's drivers")
    drive.add_argument("vehicle")
    commands.add_parser("decode", help="exchange packets in hexadecimal from standard input")
    return parser.parse_args()


def main():
    """The program; its exit code is 3 when nobody answered."""
    arguments = _arguments()
    if arguments.command == "decode":
        for line in sys.stdin:
            _print(_decoded(bytes.fromhex(line.strip())))
        return 0
    action = {"get": _get, "listen": _listen, "drive": _drive}[arguments.command]
    try:
        with Client(arguments.fleet, arguments.connect, arguments.listen, not arguments.no_multicast) as client:
            action(client, arguments)
    except NobodyAnswered as error:
        print(error, file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        sys.exit(main())
