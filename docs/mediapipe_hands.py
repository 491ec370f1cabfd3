#!/usr/bin/env python3
"""Hands before a webcam as the JSON lines that `weldpath scan --hands -` reads, by MediaPipe's hand landmarks.

    python3 docs/mediapipe_hands.py | weldpath scan --hands - --port PORT --out scan

needs the packages mediapipe and opencv-python; Escape in the picture's window ends it. The conversion below is tested on
made landmarks (tests/tests/live/hands_live.rs); the capture at the end has not been run: no camera was at hand.

The frame is the one of docs/pendant.md: millimetres, x right, y up, z toward the user. The webcam stands before the user and
looks at them, the picture is not mirrored. A hand half a metre before it in the picture's middle is in the middle of the default box.
"""
import json
import math
import sys

# MediaPipe's numbers of the landmarks.
WRIST, THUMB_JOINT, THUMB_TIP, INDEX_BASE, INDEX_TIP, MIDDLE_BASE, LITTLE_BASE = 0, 3, 4, 5, 8, 9, 17
PALM = (0, 5, 9, 13, 17)
# Base, middle joint and tip of index to little finger.
FINGERS = ((5, 6, 8), (9, 10, 12), (13, 14, 16), (17, 18, 20))

# Of a common webcam 640 pixels wide, 62 degrees across; calibrate for a distance that is right to more than a tenth.
FOCAL_WIDTHS = 0.83
# The middle of the default interaction box, and its distance from the webcam, mm.
BOX_CENTER_MM = (0.0, 200.0, 0.0)
BOX_DISTANCE_MM = 500.0
# Thumb and index: tips that touch, and tips that are as far apart as in an open hand, mm.
PINCHED_MM, OPEN_MM = 15.0, 70.0


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def length(a):
    return math.sqrt(sum(x * x for x in a))


def unit(a):
    return [x / length(a) for x in a]


def mean(points):
    return [sum(axis) / len(points) for axis in zip(*points)]


def share(value, zero, one):
    """0 at `zero`, 1 at `one`, between them in proportion."""
    return min(max((value - zero) / (one - zero), 0.0), 1.0)


def in_sensor_mm(world):
    """World landmarks, metres with x along the picture, y down and z away from the webcam, in the sensor's frame."""
    return [[-1000.0 * x, -1000.0 * y, 1000.0 * z] for x, y, z in world]


def palm_mm(picture, hand_mm, aspect):
    """Where the palm is: where its landmarks, turned as they are, are seen where the picture has them.

    `picture`: 0 to 1 along its width and height. With p the landmarks from the palm's middle, t that middle from the webcam and
    u where they are seen: f (p_xy + t_xy) = u (p_z + t_z), for t in the sense of least squares.
    """
    middle = mean([hand_mm[k] for k in PALM])
    about = [minus(hand_mm[k], middle) for k in PALM]
    seen = [(0.5 - picture[k][0], (0.5 - picture[k][1]) / aspect) for k in PALM]
    seen_middle = mean(seen)
    bent = mean([[u * p[2], v * p[2]] for (u, v), p in zip(seen, about)])
    above = below = 0.0
    for u, p in zip(seen, about):
        for k in range(2):
            spread = u[k] - seen_middle[k]
            above += spread * (FOCAL_WIDTHS * p[k] - u[k] * p[2] + bent[k])
            below += spread * spread
    distance_mm = above / below
    aside_mm = [(bent[k] + seen_middle[k] * distance_mm) / FOCAL_WIDTHS for k in range(2)]
    offset = (*aside_mm, distance_mm - BOX_DISTANCE_MM)
    return [c + o for c, o in zip(BOX_CENTER_MM, offset)]


def extended(hand_mm):
    """Thumb to little finger: a tip that is farther from the wrist than the finger's middle joint."""
    reach = lambda k: math.dist(hand_mm[k], hand_mm[WRIST])
    fingers = [reach(tip) > 1.05 * reach(joint) for _, joint, tip in FINGERS]
    aside = lambda k: math.dist(hand_mm[k], hand_mm[LITTLE_BASE])
    return [aside(THUMB_TIP) > 1.05 * aside(THUMB_JOINT), *fingers]


def grab(hand_mm):
    """0 for an open hand, 1 for a fist: how near the tips are to the wrist, in bases' distances from it."""
    reach = lambda k: math.dist(hand_mm[k], hand_mm[WRIST])
    return share(mean([[reach(tip) / reach(base)] for base, _, tip in FINGERS])[0], 1.7, 0.9)


def hand(is_right, confidence, picture, world, aspect):
    """One hand: `picture` and `world` are MediaPipe's 21 landmarks, triples; `aspect` is the picture's width to its height."""
    hand_mm = in_sensor_mm(world)
    to_index, to_little = (minus(hand_mm[k], hand_mm[WRIST]) for k in (INDEX_BASE, LITTLE_BASE))
    # Out of the palm: palm down, the right hand's index is left of its little finger.
    normal = cross(to_index, to_little) if is_right else cross(to_little, to_index)
    return {
        "is_right": is_right,
        "palm_mm": palm_mm(picture, hand_mm, aspect),
        "direction": unit(minus(hand_mm[MIDDLE_BASE], hand_mm[WRIST])),
        "normal": unit(normal),
        "grab": grab(hand_mm),
        "pinch": share(math.dist(hand_mm[THUMB_TIP], hand_mm[INDEX_TIP]), OPEN_MM, PINCHED_MM),
        "extended": "".join("01"[finger] for finger in extended(hand_mm)),
        "confidence": confidence,
    }


def line(timestamp_us, hands):
    return json.dumps({"timestamp_us": timestamp_us, "hands": hands})


def capture():
    """Not run: no camera was at hand."""
    import cv2
    import mediapipe

    camera, started = cv2.VideoCapture(0), cv2.getTickCount()
    with mediapipe.solutions.hands.Hands(max_num_hands=2) as model:
        while True:
            there, image = camera.read()
            if not there:
                break
            time_us = round((cv2.getTickCount() - started) / cv2.getTickFrequency() * 1e6)
            found = model.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            triples = lambda marks: [(mark.x, mark.y, mark.z) for mark in marks.landmark]
            hands = [
                # MediaPipe names the hands as a mirrored picture shows them; this one is not.
                hand(side.classification[0].label == "Left", side.classification[0].score, triples(picture),
                     triples(world), image.shape[1] / image.shape[0])
                for side, picture, world in zip(found.multi_handedness or [], found.multi_hand_landmarks or [],
                                                found.multi_hand_world_landmarks or [])
            ]
            print(line(time_us, hands), flush=True)
            cv2.imshow("hands", image)
            if cv2.waitKey(1) == 27:
                break
    camera.release()


if __name__ == "__main__":
    try:
        capture()
    except BrokenPipeError:
        sys.exit("the reader has ended")
