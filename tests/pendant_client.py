#!/usr/bin/env python3
"""A pendant's host in Python's standard library, written from docs/protocol.md alone: no line of it knows the Rust.

    pendant_client.py SOCKET

loads a path of 60 mm, starts it, holds it, dies, attaches anew, resumes and finishes. What the operator has to do at the
panel is asked for on standard output, one word a line: `release`, `grip`, `confirm`, `reset`.
"""
import os
import select
import socket
import struct
import sys
import time
import zlib

VERSION = 4
STATES = "Disabled Idle Loading Ready Running Holding Held Fault".split()
ENABLE, ENABLED, POSE_KNOWN = 1 << 1, 1 << 2, 1 << 8


def schema():
    """CRC-32 of the golden payloads, which the document lists in their order."""
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "docs", "protocol.md")
    rows = [line.split("`") for line in open(path, encoding="utf-8") if line.startswith("| `") and line.count("`") == 4]
    return zlib.crc32(b"".join(bytes.fromhex(row[3]) for row in rows))


def varint(number):
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def i32(number):
    return varint((number << 1 ^ number >> 31) & 0xFFFFFFFF)


def i16(number):
    return varint((number << 1 ^ number >> 15) & 0xFFFF)


class Reader:
    def __init__(self, data):
        self.data, self.at = data, 0

    def byte(self):
        self.at += 1
        return self.data[self.at - 1]

    def varint(self):
        number = shift = 0
        while True:
            byte = self.byte()
            number |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return number

    def option(self, read):
        return read() if self.byte() else None

    def signed(self):
        number = self.varint()
        return number >> 1 ^ -(number & 1)

    def pose(self):
        position = [self.signed() for _ in range(3)]
        self.at += 8
        return position, struct.unpack("<4h", self.data[self.at - 8:self.at])


def cobs(data):
    out, block = bytearray(), bytearray()
    for byte in data + b"\0":
        if byte:
            block.append(byte)
        if not byte or len(block) == 254:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
    return bytes(out)


def uncobs(data):
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        out += data[at + 1:at + code]
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


def frame(session, message):
    payload = varint(session) + message
    return b"\0" + cobs(payload + struct.pack("<I", zlib.crc32(payload))) + b"\0"


def waypoint(x_um, feed, weld):
    pose = i32(x_um) + i32(0) + i32(200_000) + struct.pack("<4h", 32767, 0, 0, 0)
    return pose + varint(feed) + bytes([weld]), struct.pack("<3i4hIB", x_um, 0, 200_000, 32767, 0, 0, 0, feed, weld)


class Host:
    def __init__(self, path):
        self.line = socket.socket(socket.AF_UNIX)
        self.line.connect(path)
        self.line.settimeout(5.0)
        self.buffer, self.session, self.request, self.pings = b"", 0, 0, 0
        self.tick, self.seen, self.pinged, self.inbox = 0, None, 0.0, []

    def send(self, message, session=None):
        self.line.sendall(frame(self.session if session is None else session, message))

    def turn(self):
        now = time.monotonic()
        if self.session and now - self.pinged > 0.025:
            self.pinged, self.pings = now, self.pings + 1
            self.send(b"\x03" + varint(self.pings) + varint(self.tick) + varint(self.pings))
        if select.select([self.line], [], [], 0.01)[0]:
            self.buffer += self.line.recv(4096)
        *frames, self.buffer = self.buffer.split(b"\0")
        for data in filter(None, frames):
            body = uncobs(data)
            payload, crc = body[:-4], body[-4:]
            if len(body) > 4 and struct.pack("<I", zlib.crc32(payload)) == crc:
                self.take(Reader(payload))

    def take(self, r):
        session, tag = r.varint(), r.varint()
        if tag == 5:
            r.varint()
            self.tick = max(self.tick, r.varint())
        elif tag == 7:
            self.telemetry(r)
        elif tag == 6:
            self.send(b"\x04" + varint(r.varint()))
        else:
            self.inbox.append((session, tag, r))

    def telemetry(self, r):
        seen = {"tick": r.varint(), "state": STATES[r.varint()], "changes": r.varint()}
        seen["cause"], seen["fault"] = r.option(r.varint), r.option(r.varint)
        r.varint()
        seen["pins"], seen["finished"] = r.varint(), r.option(r.varint)
        seen["load"] = r.option(lambda: [r.varint() for _ in range(4)])
        seen["segment"] = r.varint()
        self.tick, self.seen = max(self.tick, seen["tick"]), seen

    def wait(self, what, test, limit=60.0):
        end = time.monotonic() + limit
        while time.monotonic() < end:
            self.turn()
            found = test()
            if found:
                return found
        raise SystemExit(f"waited for {what}; last seen {self.seen}")

    def message(self, *tags):
        for entry in self.inbox:
            if entry[1] in tags:
                self.inbox.remove(entry)
                return entry
        return None

    def open(self, nonce, former=None):
        hello = varint(VERSION) + varint(schema()) + varint(nonce)
        text = b"\0" + hello if former is None else b"\x05" + hello + former
        self.session, end = 0, time.monotonic() + 10
        while time.monotonic() < end:
            self.send(text, 0)
            until = time.monotonic() + 0.25
            while time.monotonic() < until:
                self.turn()
                got = self.message(0, 1, 11)
                if got and got[1] == 0:
                    r = got[2]
                    r.varint(), r.varint(), r.varint()
                    self.tick, self.request = r.varint(), r.varint()
                    self.session, self.pings = got[0], 0
                    return
        raise SystemExit("no session")

    def ask(self, command):
        self.request = (self.request + 1) & 0xFFFF
        control, end = b"\x01" + varint(self.request) + command, time.monotonic() + 20
        while time.monotonic() < end:
            self.send(control)
            until = time.monotonic() + 0.25
            while time.monotonic() < until:
                self.turn()
                got = self.message(2)
                if got and got[2].varint() == self.request:
                    answer = got[2].varint()
                    return ("done",) if answer == 0 else ("refused", got[2].varint())
        raise SystemExit("no reply")

    def must(self, command):
        answer = self.ask(command)
        if answer != ("done",):
            raise SystemExit(f"{command.hex()}: {answer}; {self.seen}")


def operator(word):
    print(word, flush=True)


def grip(host):
    operator("release")
    host.wait("the release", lambda: host.seen and not host.seen["pins"] & ENABLE)
    operator("grip")
    host.wait("the grip", lambda: host.seen["pins"] & ENABLED)


def load(host, waypoints):
    total = len(waypoints)
    times = b"".join(map(varint, (100, 1000, 200, 60, 300)))
    begin = varint(1) + varint(total) + b"\x04\0" + varint(1_000_000) + varint(5_000) + i16(32_000) + b"\x01" + times
    host.must(b"\x05" + begin)
    digest = zlib.crc32(struct.pack("<I", total))
    for first in range(0, total, 4):
        part = waypoints[first:first + 4]
        for _ in range(20):
            host.send(b"\x02" + varint(1) + varint(first) + varint(len(part)) + b"".join(w for w, _ in part))
            until = time.monotonic() + 0.25
            acked = None
            while time.monotonic() < until and acked is None:
                host.turn()
                got = host.message(3, 4)
                if got and got[1] == 4:
                    raise SystemExit("a chunk was refused")
                if got and got[2].varint() == 1 and got[2].varint() >= first + len(part):
                    acked = True
            if acked:
                break
    for _, fixed in waypoints:
        digest = zlib.crc32(struct.pack("<I", digest) + fixed)
    host.must(b"\x06" + varint(1) + varint(digest))
    return digest


def held(host):
    host.wait("the hold", lambda: host.seen["state"] == "Held")


def go_on(host):
    """Gripped anew, armed, resumed 2 mm back."""
    held(host)
    grip(host)
    host.must(b"\x08\x01")
    host.must(b"\x0c" + varint(1) + varint(host.seen["changes"]) + varint(2_000))
    host.wait("the way on", lambda: host.seen["state"] != "Held")


def main():
    waypoints = [waypoint(400_000 + 1_000 * k, 20_000, 2 <= k < 58) for k in range(60)]
    host = Host(sys.argv[1])
    host.open(0x5EED0001)
    host.wait("a state", lambda: host.seen)
    while host.seen["fault"] is not None:
        operator("reset")
        end = time.monotonic() + 0.5
        host.wait("half a second", lambda: time.monotonic() > end)
    digest = load(host, waypoints)
    grip(host)
    assert host.ask(b"\x09" + varint(1)) == ("refused", 12), "nobody knows where the torch is"
    operator("confirm")
    host.wait("the confirmation", lambda: host.seen["pins"] & POSE_KNOWN)
    host.must(b"\x08\x01")
    host.must(b"\x09" + varint(1))
    host.wait("the weld", lambda: host.seen["segment"] >= 10)
    host.must(b"\x0a")
    go_on(host)
    host.wait("more of it", lambda: host.seen["segment"] >= 20 or host.seen["state"] == "Held")
    # This host dies: nothing is said for a second. Another one goes on.
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        time.sleep(0.05)
    host.seen = None
    host.open(0x5EED0002, varint(0x5EED0001) + varint(1) + varint(digest))
    host.wait("a state", lambda: host.seen)
    go_on(host)
    while not host.wait("the end", lambda: host.seen["finished"] == 1 and "finished" or host.seen["state"]) == "finished":
        if host.seen["state"] == "Held":
            # On a busy machine this host may itself have been silent for too long.
            go_on(host)
        host.turn()
    print("finished", flush=True)


main()
