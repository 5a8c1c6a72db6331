"""Driving function in a process of its own: straight on, two seconds behind whoever is ahead."""

import json
import math
import sys


def gap_ahead(me: dict, others: list) -> tuple[float, float]:
    """Distance to the nearest vehicle ahead in a strip as wide as a lane, and its speed; m, m/s."""
    found = (math.inf, 0.0)
    for other in others:
        dx, dy = other["x"] - me["x"], other["y"] - me["y"]
        ahead = dx * math.cos(me["heading"]) + dy * math.sin(me["heading"])
        aside = dy * math.cos(me["heading"]) - dx * math.sin(me["heading"])
        if ahead > 0 and abs(aside) < 1.5:
            found = min(found, (ahead - (me["length"] + other["length"]) / 2, other["speed"]))
    return found


def plan(me: dict, others: list, step_s: float, steps: int) -> dict:
    """Straight on at the speed that keeps the distance."""
    gap, _ = gap_ahead(me, others)
    wanted = me["speed"] if gap > 2 * me["speed"] else max(0.0, gap / 2)
    answer = {"x": [], "y": [], "heading": [], "speed": []}
    x, y, speed = me["x"], me["y"], me["speed"]
    for _ in range(steps):
        speed += max(-4 * step_s, min(2 * step_s, wanted - speed))
        x += speed * step_s * math.cos(me["heading"])
        y += speed * step_s * math.sin(me["heading"])
        for key, value in zip(answer, (x, y, me["heading"], speed), strict=True):
            answer[key].append(value)
    return answer


setup = json.loads(sys.stdin.readline())  # the road; here only the numbers are of interest
print(json.dumps({"ready": True}), flush=True)
for line in sys.stdin:
    scene = json.loads(line)
    answer = plan(scene["vehicle"], scene["others"], setup["step_s"], setup["plan_steps"])
    print(json.dumps(answer), flush=True)
