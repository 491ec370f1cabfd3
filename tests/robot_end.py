#!/usr/bin/env python3
"""A robot's end of the robot port, written from docs/robot-port.md alone, to attack the pendant with.

    robot_end.py SOCKET X,Y,Z [--every N] [--fresh TICKS] [--record FILE] [--replay FILE]
    robot_end.py --check GOLDEN

X,Y,Z is where the flange is at first, in um. Orders come as lines on standard input and take effect at once:

    good                 ends every attack and fault below, drives follow again
    mute, speak          says nothing (and counts no sequence); speaks again
    stop, off, follow    drives 2, 0, 1
    freeze               does not move and reports no error
    aside UM             reports its pose so far beside along y, and no error
    lag S, slow MM_S     time constant (0.012), fastest speed (500)
    late N, drop N       each answer waits until N more are due; every Nth answer is lost
    put X,Y,Z            somebody moved the arm there
    nonce                restarts: new nonce, sequence from 1
    report               prints one line of JSON, as does the end of standard input or of the socket

Attacks, one at a time, in place of the honest answers; with the word `also` behind it, before each of them:

    old-session  future  stale [N]  frozen-sequence  other-robot  version N  drives N  nan-like  far  replay
    bad-crc  garbage  truncated  doubled  flip  huge  zeros

Time is the pendant's: the arm moves by the ticks that passed, never by the clock of this computer.
"""
import argparse
import json
import math
import os
import random
import select
import socket
import struct
import sys
import time
import zlib
from collections import Counter, deque
from collections.abc import Iterator
from typing import Any, NamedTuple

MASK = 0xFFFF_FFFF
TICK_S = 0.002
POSE, MOTION, ARC = 1, 2, 4
SET_POINT, ACTUAL = struct.Struct("<BBHIIII3i4h"), struct.Struct("<BBHIIII3i4hI")
ATTACKS = {
    "old-session", "future", "stale", "frozen-sequence", "other-robot", "version", "drives", "nan-like",
    "far", "replay", "bad-crc", "garbage", "truncated", "doubled", "flip", "huge", "zeros",
}
Place = tuple[float, ...]  # x y z in um
Quat = tuple[float, ...]  # w x y z of length 1


# ---- bytes ----

def cobs(data: bytes) -> bytes:
    out = bytearray()
    for part in data.split(b"\0"):
        while len(part) >= 254:
            out += b"\xff" + part[:254]
            part = part[254:]
        out += bytes([len(part) + 1]) + part
    return bytes(out)


def uncobs(data: bytes) -> bytes | None:
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        end = at + code
        if code == 0 or end > len(data):
            return None
        out += data[at + 1:end]
        at = end
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


def frame(payload: bytes, spoil: int = 0) -> bytes:
    return b"\0" + cobs(payload + struct.pack("<I", zlib.crc32(payload) ^ spoil)) + b"\0"


def unframe(chunk: bytes) -> bytes | None:
    """The payload of what lay between two zeros, or None."""
    data = uncobs(chunk)
    if data is None or len(data) < 4:
        return None
    payload = data[:-4]
    return payload if struct.pack("<I", zlib.crc32(payload)) == data[-4:] else None


class SetPoint(NamedTuple):
    version: int
    flags: int
    lost: int
    session: int
    tick: int
    robot: int
    heard: int
    place: tuple[int, ...]
    quat: tuple[int, ...]

    @classmethod
    def read(cls, payload: bytes) -> "SetPoint":
        f = SET_POINT.unpack(payload)
        return cls._make((*f[:7], f[7:10], f[10:]))

    def write(self) -> bytes:
        return SET_POINT.pack(*self[:7], *self.place, *self.quat)

    def contradictions(self) -> Iterator[str]:
        if self.flags & POSE and abs(math.hypot(*self.quat) / 32767 - 1) > 1e-3:
            yield "no unit quaternion"
        if not self.flags & POSE and any(self.place + self.quat):
            yield "a pose without its flag"
        if self.flags & MOTION and not self.flags & POSE:
            yield "motion without pose"
        if self.flags & ARC and not self.flags & MOTION:
            yield "arc without motion"
        if self.robot == 0 and self.heard != 0:
            yield "heard without robot"


class Actual(NamedTuple):
    version: int
    drives: int
    lost: int
    robot: int
    sequence: int
    session: int
    heard: int
    place: tuple[int, ...]
    quat: tuple[int, ...]
    error_um: int

    @classmethod
    def read(cls, payload: bytes) -> "Actual":
        f = ACTUAL.unpack(payload)
        return cls._make((*f[:7], f[7:10], f[10:14], f[14]))

    def write(self) -> bytes:
        return ACTUAL.pack(*self[:7], *self.place, *self.quat, self.error_um)


# ---- poses ----

def unit(quat: Quat) -> Quat:
    length = math.hypot(*quat)
    return tuple(v / length for v in quat) if length else (1.0, 0.0, 0.0, 0.0)


def angle(a: Quat, b: Quat) -> float:
    """Angle of rotation from a to b in rad, exact for small ones; q and -q are the same."""
    return 4 * math.asin(min(1.0, min(math.dist(a, b), math.dist(a, [-v for v in b])) / 2))


def toward(a: Quat, b: Quat, part: float) -> Quat:
    sign = 1 if sum(x * y for x, y in zip(a, b)) >= 0 else -1
    return unit(tuple(x + part * (sign * y - x) for x, y in zip(a, b)))


def too_far(mm: float, rad: float, ticks: int | None) -> bool:
    """Whether a set-point is a jump; without ticks it is the first of a motion."""
    if ticks is None:
        return mm > 3 or math.degrees(rad) > 3
    return mm > 0.5 * ticks + 0.1 or rad > math.pi * TICK_S * ticks + 0.001


# ---- the robot's end ----

class RobotEnd:
    def __init__(self, place: Place, every: int, fresh_ticks: int, record: Any, replay: list[bytes]) -> None:
        self.every = every
        # For so long a frame may take to give an answer back.
        self.fresh = fresh_ticks
        self.record, self.replay = record, replay
        self.replayed = 0
        self.buffer = bytearray()
        self.history: deque[bytes] = deque(maxlen=10_000)
        self.count: Counter[str] = Counter()
        self.altered: Counter[str] = Counter()
        self.own_stops: Counter[str] = Counter()
        self.most = dict.fromkeys(("farthest_jump_mm", "farthest_jump_deg", "first_mm", "ahead_mm"), 0.0)
        self.since: list[dict[str, Any]] = []
        self.open: list[tuple[dict[str, Any], int, Place | None]] = []
        self.clock = 0  # ticks that passed, over all sessions
        self.unanswered = 0  # frames since the last answer
        self.place, self.quat = place, unit(())
        self.seen: SetPoint | None = None  # the last frame if it was one with motion
        self.good()
        self.restart()

    def good(self) -> None:
        self.attack, self.number, self.also = "", 0, False
        self.mute = self.freeze = False
        self.aside, self.lag, self.speed = 0, 0.012, 500.0
        self.late = self.drop = 0
        self.held: deque[bytes] = deque()
        self.drives = 1
        self.due = 0

    def restart(self) -> None:
        self.nonce, self.other = (random.SystemRandom().randrange(1, MASK) for _ in range(2))
        self.sequence = self.other_sequence = self.lost = 0
        self.told: dict[int, int] = {}  # the tick at which each answer was given
        self.newest: SetPoint | None = None
        self.stopped = self.stop_said = False
        self.stand()

    def stand(self) -> None:
        """Stops where it is; the next set-point is the first of a motion."""
        self.goal: tuple[Place, Quat] = (self.place, self.quat)
        self.followed: SetPoint | None = None

    def stop(self, why: str) -> None:
        """Stops by itself, and says drives 2 until motion ends and it was said."""
        if not self.stopped:
            self.own_stops[why] += 1
            self.stopped, self.stop_said = True, False
        self.stand()

    # -- what comes in --

    def receive(self, data: bytes) -> None:
        self.buffer += data
        *chunks, rest = bytes(self.buffer).split(b"\0")
        self.buffer = bytearray(rest)
        for chunk in filter(None, chunks):
            payload = unframe(chunk)
            if payload is None or len(payload) != SET_POINT.size:
                self.count["no_frame_bytes"] += len(chunk)
                continue
            point = SetPoint.read(payload)
            if point.version != 2:
                self.count["other_version"] += 1
            elif point.flags & ~(POSE | MOTION | ARC):
                self.altered["unknown flags"] += 1
            else:
                self.take(point)

    def take(self, point: SetPoint) -> None:
        last = self.newest
        same = last is not None and last.session == point.session
        gap = (point.tick - last.tick) & MASK if last and same else 1
        ahead = 0 < gap < 1 << 31
        gap = gap if ahead else 0
        for why in point.contradictions():
            self.altered[why] += 1
        if not ahead:
            self.altered["tick not ahead"] += 1
        elif gap > 1:
            self.count["lost"] += gap - 1
            self.lost = (self.lost + gap - 1) & 0xFFFF
        if last and not same:
            self.count["sessions"] += 1
        self.count["frames"] += 1
        for flag, name in ((POSE, "pose"), (MOTION, "motion"), (ARC, "arc")):
            self.count[name] += bool(point.flags & flag)
        self.count["other_nonce"] += point.robot not in (0, self.nonce)
        self.clock += gap
        self.unanswered += 1

        why = self.unfollowed(point, same, ahead, gap)
        if ahead:
            self.newest = point
        self.watch(point, same, gap)
        if not point.flags & MOTION:
            self.followed = None
            self.stopped = self.stopped and not self.stop_said
        elif self.drives != 1 or self.stopped:
            self.stand()
        elif why:
            self.stop(why)
        else:
            self.followed = point
            self.goal = (point.place, unit(point.quat))
        self.move(gap)
        if point.flags & MOTION and point.flags & POSE:
            self.highest("ahead_mm", math.dist(self.place, point.place) / 1000)

    def unfollowed(self, point: SetPoint, same: bool, ahead: bool, gap: int) -> str:
        """Why a frame with motion is not followed, or nothing."""
        if point.robot != self.nonce:
            return "nonce"
        told = self.told.get(point.heard)
        if told is None or self.clock - told > self.fresh:
            return "age"
        if not ahead:
            return "order"
        if self.newest and not same and self.followed:
            return "session"
        if self.followed and gap > 5:
            return "silence"
        if not point.flags & POSE:
            return "pose"
        place, quat = self.goal if self.followed else (self.place, self.quat)
        mm, rad = math.dist(place, point.place) / 1000, angle(quat, unit(point.quat))
        return "jump" if too_far(mm, rad, gap if self.followed else None) else ""

    def watch(self, point: SetPoint, same: bool, gap: int) -> None:
        """Counts jumps, and times what followed upon each order."""
        if point.flags & MOTION and point.flags & POSE:
            if self.seen and same:
                mm = math.dist(self.seen.place, point.place) / 1000
                rad = angle(unit(self.seen.quat), unit(point.quat))
                self.count["jumps"] += too_far(mm, rad, gap)
                self.highest("farthest_jump_mm", mm)
                self.highest("farthest_jump_deg", math.degrees(rad))
            else:
                mm, rad = math.dist(self.place, point.place) / 1000, angle(self.quat, unit(point.quat))
                self.count["jumps"] += too_far(mm, rad, None)
                self.highest("first_mm", mm)
            self.seen = point
        else:
            self.seen = None
        still = []
        for entry, start, place in self.open:
            if not point.flags & MOTION and entry["motion_off"] is None:
                entry["motion_off"] = self.clock - start
            if not point.flags & ARC and entry["arc_off"] is None:
                entry["arc_off"] = self.clock - start
            if entry["motion_off"] is None and point.flags & POSE:
                place = place or point.place
                entry["moved_mm"] = max(entry["moved_mm"], round(math.dist(place, point.place) / 1000, 3))
            if entry["motion_off"] is None or entry["arc_off"] is None:
                still.append((entry, start, place))
        self.open = still

    def highest(self, name: str, value: float) -> None:
        self.most[name] = max(self.most[name], round(value, 3))

    def move(self, ticks: int) -> None:
        """First-order lag behind the goal, no faster than the arm can."""
        if self.freeze or self.drives != 1:
            return
        part = 1 - math.exp(-TICK_S / self.lag) if self.lag > 0 else 1.0
        for _ in range(min(ticks, 1000)):
            far = math.dist(self.place, self.goal[0])
            step = min(part * far, self.speed * 1000 * TICK_S)
            if far > 0:
                self.place = tuple(a + (b - a) * step / far for a, b in zip(self.place, self.goal[0]))
            self.quat = toward(self.quat, self.goal[1], part)

    # -- what goes out --

    def honest(self) -> Actual:
        self.sequence = (self.sequence + 1) & MASK
        self.told[self.sequence] = self.clock
        x, y, z = (max(-1 << 31, min((1 << 31) - 1, round(v))) for v in self.place)
        silent = self.freeze or self.aside
        error = 0 if silent else min(MASK, round(math.dist(self.place, self.goal[0])))
        drives = 2 if self.stopped and self.drives == 1 else self.drives
        self.stop_said = self.stopped
        session, heard = (self.newest.session, self.newest.tick) if self.newest else (0, 0)
        quat = tuple(round(v * 32767) for v in self.quat)
        y = max(-1 << 31, min((1 << 31) - 1, y + self.aside))
        return Actual(2, drives, self.lost, self.nonce, self.sequence, session, heard, (x, y, z), quat, error)

    def answer(self) -> bytes:
        """The bytes for the line, if an answer is due: to the newest frame, where several came at once."""
        if self.unanswered < self.every or self.newest is None:
            return b""
        self.unanswered = 0
        if self.mute:
            return b""
        actual = self.honest()
        good = frame(actual.write())
        self.history.append(good)
        if self.record:
            print(good.hex(), file=self.record, flush=True)
        sent = self.attacked(actual, good) + (good if self.also else b"") if self.attack else good
        self.held.append(sent)
        out = b""
        while len(self.held) > self.late:
            sent = self.held.popleft()
            self.due += 1
            if not self.drop or self.due % self.drop:
                self.count["answers"] += 1
                out += sent
        return out

    def attacked(self, actual: Actual, good: bytes) -> bytes:
        def changed(**fields: Any) -> bytes:
            return frame(actual._replace(**fields).write())

        match self.attack:
            case "old-session":
                return changed(session=(actual.session - 1) & MASK)
            case "future":  # so far ahead that it is still future where a busy machine delivers it late
                return changed(heard=(actual.heard + 1000) & MASK)
            case "stale":
                return self.history[-min(len(self.history), self.number + 1)]
            case "frozen-sequence":
                return changed(sequence=self.number)
            case "other-robot":  # its pose is elsewhere, so that one who believes it shows that
                self.other_sequence = (self.other_sequence + 1) & MASK
                x, y, z = actual.place
                place = (x, y + (-100_000 if y > 0 else 100_000), z)
                return good + changed(robot=self.other, sequence=self.other_sequence, place=place)
            case "version":
                return changed(version=self.number)
            case "drives":
                return changed(drives=self.number)
            case "nan-like":
                return changed(quat=(0, 0, 0, 0))
            case "far":
                return changed(place=((1 << 31) - 1,) * 3)
            case "replay":
                self.replayed += 1
                return self.replay[(self.replayed - 1) % len(self.replay)]
            case "bad-crc":
                return frame(actual.write(), spoil=random.randrange(1, MASK))
            case "garbage":
                return random.randbytes(random.randrange(1, 120))
            case "truncated":  # cut off on the line, or a short payload with a good CRC
                cut = random.randrange(1, 44)
                return good[:cut] if random.random() < 0.5 else frame(actual.write()[:cut])
            case "doubled":
                return good + good
            case "flip":
                spoilt = bytearray(good)
                spoilt[random.randrange(len(good))] ^= 1 << random.randrange(8)
                return bytes(spoilt)
            case "huge":
                return b"\0" + bytes(random.choices(range(1, 256), k=5000)) + b"\0"
            case "zeros":
                return bytes(64)
        raise ValueError(self.attack)

    # -- orders --

    def order(self, text: str) -> None:
        name, *words = text.split()
        also = "also" in words
        word = next((w for w in words if w != "also"), "")
        if name == "report":
            self.report()
            return
        if name in ATTACKS:
            number = int(word) if word else {"stale": 200, "frozen-sequence": self.sequence}.get(name, 0)
            limit = 255 if name in ("version", "drives") else MASK
            if not 0 <= number <= limit or name in ("version", "drives") and not word:
                raise ValueError("needs a number that fits its field")
            if name == "replay" and not self.replay:
                raise ValueError("--replay is missing")
            self.attack, self.number, self.also = name, number, also
        else:
            match name:
                case "good":
                    self.good()
                case "mute" | "speak":
                    self.mute = name == "mute"
                case "stop" | "off" | "follow":
                    self.drives = {"stop": 2, "off": 0, "follow": 1}[name]
                    self.stand()
                case "freeze":
                    self.freeze = True
                case "aside":
                    self.aside = int(word)
                case "lag":
                    self.lag = float(word)
                case "slow":
                    self.speed = float(word)
                case "late":
                    self.late = int(word)
                case "drop":
                    self.drop = int(word)
                case "put":
                    self.place = read_place(word)
                    if not self.followed:  # else the set-points pull it back
                        self.goal = (self.place, self.quat)
                case "nonce":
                    self.restart()
                case _:
                    raise ValueError("no such order")
        flags = self.newest.flags if self.newest else 0
        entry = {
            "order": text, "motion": bool(flags & MOTION), "arc": bool(flags & ARC),
            "motion_off": None, "arc_off": None, "moved_mm": 0.0,
        }
        self.since.append(entry)
        self.open.append((entry, self.clock, self.newest.place if self.newest and flags & POSE else None))

    def report(self) -> None:
        names = (
            "frames", "no_frame_bytes", "lost", "motion", "arc", "pose", "jumps", "answers", "sessions",
            "other_nonce", "other_version",
        )
        out: dict[str, Any] = {name: self.count[name] for name in names}
        out |= {"altered": sum(self.altered.values()), "altered_why": self.altered, **self.most}
        out |= {"own_stops": self.own_stops, "flange": [round(v) for v in self.place], "ticks": self.clock}
        print(json.dumps(out | {"since": self.since}), flush=True)


# ---- the program ----

def read_place(text: str) -> Place:
    x, y, z = (float(v) for v in text.split(","))
    return (x, y, z)


def connect(path: str) -> socket.socket:
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    # Little waits in the socket, so that answers do not grow old there.
    line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    for attempt in range(100):
        try:
            line.connect(path)
            break
        except (FileNotFoundError, ConnectionRefusedError):
            if attempt == 99:
                raise
            time.sleep(0.1)
    line.setblocking(False)
    return line


def run(end: RobotEnd, line: socket.socket) -> None:
    orders, pending, up = b"", b"", True
    inputs: list[Any] = [0, line]
    while up:
        readable, _, _ = select.select(inputs, [line] if pending else [], [])
        # Frames first: those that wait came before the order.
        if line in readable:
            try:
                data = line.recv(65536)
            except ConnectionResetError:
                data = b""
            up = bool(data)
            end.receive(data)
        if 0 in readable:
            data = os.read(0, 65536)
            up = up and bool(data)
            *texts, orders = (orders + data).split(b"\n")
            for text in filter(None, (t.decode(errors="replace").strip() for t in texts)):
                try:
                    end.order(text)
                except (ValueError, OverflowError) as why:
                    print(f"robot_end: order {text!r}: {why}", file=sys.stderr, flush=True)
        try:
            # While the line is behind, no answer is made: the next one is to the newest frame.
            pending = pending or end.answer()
            if pending:
                pending = pending[line.send(pending):]
        except BlockingIOError:
            pass
        except (BrokenPipeError, ConnectionResetError):
            up = False
    end.report()


def check(path: str) -> bool:
    """Own encoding and decoding against the golden file, and that no flipped bit goes unnoticed."""
    right, names = True, set()
    for text in open(path, encoding="ascii"):
        if not text.strip() or text.startswith("#"):
            continue
        name, payload, line = text.split()
        raw, framed = bytes.fromhex(payload), bytes.fromhex(line)
        kind: type[SetPoint] | type[Actual] = SetPoint if name.startswith("set-point") else Actual
        names.add(kind)
        try:
            message = kind.read(raw)
            ok = message.write() == raw and frame(raw) == framed and unframe(framed[1:-1]) == raw
            ok &= message.version == 2
            ok &= not (isinstance(message, SetPoint) and any(message.contradictions()))
        except (struct.error, ValueError):
            ok = False
        for bit in range(8 * len(framed)):
            spoilt = bytearray(framed)
            spoilt[bit // 8] ^= 1 << bit % 8
            read = [unframe(chunk) for chunk in bytes(spoilt).split(b"\0") if chunk]
            ok &= all(r is None or r == raw for r in read)
        right &= ok
        print(f"{name}: {'ok' if ok else 'WRONG'}", file=sys.stderr)
    return right and names == {SetPoint, Actual}


def main() -> int:
    parser = argparse.ArgumentParser(description="A robot's end of the robot port that attacks the pendant")
    parser.add_argument("socket", nargs="?")
    parser.add_argument("place", nargs="?", type=read_place, metavar="X,Y,Z")
    parser.add_argument("--every", type=int, default=10, metavar="N", help="answer every Nth frame")
    # 10 by the document; as many as the emulated board allows, where neither end has the other's clock.
    parser.add_argument("--fresh", type=int, default=250, metavar="TICKS", help="oldest that is followed")
    parser.add_argument("--seed", type=int, help="makes garbage and flips the same each time")
    parser.add_argument("--record", metavar="FILE")
    parser.add_argument("--replay", metavar="FILE")
    parser.add_argument("--check", metavar="GOLDEN")
    # A place that begins with a minus is no option; the space tells argparse so.
    args = parser.parse_args([" " + a if a[:1] == "-" and a[1:2].isdigit() else a for a in sys.argv[1:]])
    random.seed(args.seed)
    if args.check:
        return 0 if check(args.check) else 1
    if not args.socket or not args.place or args.every < 1:
        parser.error("SOCKET and X,Y,Z are needed, and N of 1 or more")
    replay = [bytes.fromhex(t) for t in open(args.replay, encoding="ascii")] if args.replay else []
    record = open(args.record, "w", encoding="ascii") if args.record else None
    run(RobotEnd(args.place, args.every, args.fresh, record, replay), connect(args.socket))
    return 0


if __name__ == "__main__":
    sys.exit(main())
