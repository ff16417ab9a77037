#!/usr/bin/env python3
"""A CAM add-in in sixty lines: gives `toolmark live` one operation after the other and shows what comes back.

    toolmark live                         # or: toolmark live --machine tcp://127.0.0.1:7450
    python3 docs/live_client.py 7460      # the port that it says

The machine begins with the first operation; the second and third are said while it cuts.
"""
import json
import socket
import sys
import threading
import time


def circle(x, y, z, radius, feed):
    """Down, once around, up."""
    start = [x + radius, y, z]
    return [
        {"rapid": {"to": [x + radius, y, 5.0]}},
        {"line": {"to": start, "feed_mm_min": 300}},
        {"arc": {"to": start, "centre": [x, y, z], "direction": "ccw", "feed_mm_min": feed}},
        {"rapid": {"to": [x + radius, y, 5.0]}},
    ]


def square(z, size, feed):
    """Around the outside."""
    corners = [[0, 0, z], [size, 0, z], [size, size, z], [0, size, z], [0, 0, z]]
    path = [{"line": {"to": corner, "feed_mm_min": feed}} for corner in corners]
    return [{"rapid": {"to": [0, 0, 5.0]}}] + path + [{"rapid": {"to": [0, 0, 5.0]}}]


OPERATIONS = [
    {"name": "outside", "tool": {"number": 1, "length_mm": 120}, "spindle": {"rpm": 6000}, "coolant": {"flood": True},
     "moves": square(-1.0, 40.0, 2400)},
    {"name": "circle", "tool": {"number": 1}, "spindle": {"rpm": 6000}, "tolerance_mm": 0.02,
     "moves": circle(20.0, 20.0, -1.0, 10.0, 1500)},
    {"name": "small circle", "tool": {"number": 1}, "spindle": {"rpm": 8000},
     "moves": circle(20.0, 20.0, -2.0, 5.0, 1200)},
]


def main():
    connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
    lines = connection.makefile("r")
    progress = {"operation": 0}
    done = threading.Event()

    def say(message):
        connection.sendall((json.dumps(message) + "\n").encode())

    def listen():
        for line in lines:
            heard = json.loads(line)
            if "progress" in heard:
                progress.update(heard["progress"])
            else:
                print(line.strip(), flush=True)
        done.set()

    threading.Thread(target=listen, daemon=True).start()
    say({"connect": {"client": "live_client.py", "job": "plate"}})
    say({"start": {}})
    for number, operation in enumerate(OPERATIONS, start=1):
        say({"operation": operation})
        # The next one is planned while this one is cut.
        while progress["operation"] < number and not done.wait(0.05):
            pass
        print(json.dumps({"cutting": number, "said": number}), flush=True)
    if not done.is_set():
        say({"end": {}})
    done.wait()


if __name__ == "__main__":
    main()
