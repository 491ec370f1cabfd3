#!/usr/bin/env python3
"""Brings up a pendant's board: asks for each measurement, judges it, and writes the protocol.

    bring_up.py PROTOCOL.md [--board NAME] [--by NAME]

Each check says what to do, where to measure and what is expected; the answer is a number, `skip REASON` or `stop`. Nothing is
driven from here: the firmware runs, and a person works the switches and reads the oscilloscope. Exits 0 if all passed, 1 if not.
docs/board.md says how to wire, set up and flash. No board has been through it yet.
"""
import argparse
import datetime
import os
import sys
import tempfile
from typing import NamedTuple


class Check(NamedTuple):
    name: str
    do: str
    measure: str
    least: float
    most: float
    unit: str
    why: str


CHECKS = [
    Check("supply", "power the board, all switches released", "VDD at the microcontroller", 3.2, 3.4, "V",
          "the levels below hold at 3.3 V"),
    Check("outputs before start", "hold the reset pin low", "highest of PD12 to PD15", 0.0, 0.4, "V",
          "in reset the pins are inputs: their pull-downs keep arc, gas, motion and wire off"),
    Check("brown-out level", "read the log: `brown-out level`", "its number", 0, 0, "",
          "0 is level 3; set it once, docs/board.md says how"),
    Check("brown-out", "lower VDD slowly while a path waits in Ready", "VDD at which NRST falls", 2.7, 2.95, "V",
          "VBOR3, falling: below it the flash and the clock are out of their bounds"),
    Check("tick", "start a path without the arc", "period of two edges of PD14, mean of 1000", 3.9996, 4.0004, "ms",
          "a toggle a tick of 2 ms, by a crystal of 100 ppm"),
    Check("tick jitter", "the same, with the host loading another path in a loop", "spread of the edges, peak to peak",
          0.0, 40.0, "us", "the ports' interrupts come before the tick; each lasts a few us"),
    Check("emergency stop, first contact", "open PE7 while motion is on", "from the opening to the last edge of PD14",
          0.0, 2.1, "ms", "read once a tick"),
    Check("emergency stop, second contact", "open PE12 while motion is on", "from the opening to the last edge of PD14",
          0.0, 2.1, "ms", "each contact alone"),
    Check("emergency stop to relay", "open PE7 while motion is on", "from the opening to the relay's contact", 0.0, 30.0,
          "ms", "the last edge, the pump's 8 ms, the relay's own 20 ms"),
    Check("charge pump lets go", "take the pump's input off PD14 while motion is on", "from there until the pump is off",
          0.0, 8.0, "ms", "four ticks without an edge"),
    Check("charge pump, stuck high", "tie the pump's input to 3.3 V", "the pump's output, as a share of what it is", 0.0,
          10.0, "%", "a pin that is stuck energises nothing"),
    Check("charge pump, stuck low", "tie the pump's input to ground", "the pump's output, as a share of what it is", 0.0,
          10.0, "%", "a pin that is stuck energises nothing"),
    Check("read-back", "open PD9 while motion is on", "from the opening to the last edge of PD14", 0.0, 13.0, "ms",
          "what is read back may lag by five ticks: a slower relay is a fault"),
    Check("watchdog", "halt the processor by the probe while motion is on", "from the halt to the falling of NRST", 18.0,
          49.0, "ms", "26 ms nominal; its clock is 17 to 47 kHz"),
    Check("crystal lost", "short the crystal (OSC_IN to ground) while motion is on", "from there to the last edge of PD14",
          0.0, 1.0, "ms", "the clock security system raises the NMI, which switches everything off"),
    Check("no arc without the crystal", "start with OSC_IN to ground; arm the arc", "1 if it is refused, 0 if not", 1, 1,
          "", "on its internal clock the board arms nothing"),
    Check("overrun, 115200 baud", "`weldpath monitor --json` while the host streams for 60 s", "counters.overrun",
          0, 0, "bytes", "a byte takes 87 us; the interrupt a few"),
    Check("overrun, 460800 baud", "a robot's end answers each frame for 60 s", "`lost` of robot in the report", 0, 0,
          "frames", "a byte takes 22 us"),
    Check("robot silent", "take the robot's line off in the air at 50 mm/s", "from there to the last edge of PD14",
          0.0, 120.0, "ms", "5 ticks, and a controlled stop: 50 mm/s with 500 mm/s2 takes 100 ms"),
    Check("host silent", "take the host's line off while the arc burns on a dummy load", "from there until PD12 is still",
          0.0, 210.0, "ms", "200 ms of silence, and the ticks"),
    Check("enabling switch", "let PE8 go while motion is on", "from there to the last edge of PD14", 0.0, 2.1, "ms",
          "read once a tick"),
]


def asked(check: Check, number: int) -> str | float:
    print(f"\n{number}. {check.name}\n   do:       {check.do}\n   measure:  {check.measure}\n"
          f"   expected: {span(check)}\n   why:      {check.why}")
    while True:
        print("   = ", end="", flush=True)
        line = sys.stdin.readline()
        if not line or line.strip() == "stop":
            return "not measured"
        if line.startswith("skip "):
            return line.strip()
        try:
            value = float(line.replace(",", "."))
        except ValueError:
            print("   a number, `skip REASON` or `stop`")
            continue
        if value == value:
            return value


def span(check: Check) -> str:
    if check.least == check.most:
        return f"{check.least:g} {check.unit}".strip()
    return f"{check.least:g} to {check.most:g} {check.unit}".strip()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("protocol")
    parser.add_argument("--board", default="STM32F407 Discovery")
    parser.add_argument("--by", default="")
    arguments = parser.parse_args()
    rows, failed, stopped = [], 0, False
    for number, check in enumerate(CHECKS, 1):
        answer = "not measured" if stopped else asked(check, number)
        stopped = stopped or answer == "not measured"
        passed = isinstance(answer, float) and check.least <= answer <= check.most
        failed += not passed
        found = f"{answer:g} {check.unit}".strip() if isinstance(answer, float) else answer
        rows.append(f"| {number} | {check.name} | {span(check)} | {found} | {'passed' if passed else 'NOT PASSED'} |")
        if not stopped:
            print(f"   {'passed' if passed else 'NOT PASSED'}")
    result = "all passed" if failed == 0 else f"{failed} of {len(CHECKS)} not passed"
    text = "\n".join([
        f"# Bring-up of {arguments.board}", "",
        f"{datetime.date.today()}, {arguments.by or 'nobody named'}. {result}.", "",
        "| | check | expected | found | |", "|---|---|---|---|---|", *rows, "",
        "A software interlock: no certified safety function, whatever stands above.", "",
    ])
    folder = os.path.dirname(os.path.abspath(arguments.protocol))
    with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, encoding="utf-8") as file:
        file.write(text)
    os.replace(file.name, arguments.protocol)
    print(f"\n{result}: {arguments.protocol}")
    return 0 if failed == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
