"""The page's function of what the driver is told, run by Node on cases as JSON."""

import json
import shutil
import subprocess
from pathlib import Path

from flgpr.model.vehicle import Vehicle

SOURCES = Path(__file__).parents[2] / "viewer"
MISSING = shutil.which("node") is None or not (SOURCES / "node_modules").is_dir()
CALL = """
import { createInterface } from "node:readline";
import { instruct } from "./instruct";
createInterface({ input: process.stdin }).on("line", (line) => {
    const cases = JSON.parse(line) as [Parameters<typeof instruct>[0], Parameters<typeof instruct>[1]][];
    process.stdout.write(JSON.stringify(cases.map(([numbers, known]) => instruct(numbers, known))) + "\\n");
});
"""


def numbers(**changes):
    """Return the page's numbers: the table of a vehicle, and a threshold of 0."""
    return {**Vehicle.of(**changes).model_dump(), "threshold": 0.0}


def place(left, aside=0.0, confidence=1.0, name="alarm-1"):
    """Return where an alarm lies."""
    return {"id": name, "confidence": confidence, "left": left, "aside": aside}


def known(*alarms, speed=0.0, update=0.5, sight=15.0, blind=False, before="clear"):
    """Return what is known, the speed in km/h."""
    return {
        "blind": blind,
        "speed": None if speed is None else speed / 3.6,
        "update": update,
        "sight": sight,
        "alarms": list(alarms),
        "before": before,
    }


class Instructions:
    """The function, bundled once, in a process of its own."""

    def __init__(self, folder):
        self.script = folder / "instruct.cjs"
        subprocess.run(
            [
                SOURCES / "node_modules/.bin/esbuild",
                "--bundle",
                "--platform=node",
                "--sourcefile=call.ts",
                f"--outfile={self.script}",
                "--loader=ts",
                "--log-level=warning",
            ],
            input=CALL,
            text=True,
            cwd=SOURCES / "src",
            check=True,
            timeout=60,
        )

        self.node = subprocess.Popen(
            ["node", self.script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def close(self):
        """End the process."""
        self.node.stdin.close()
        self.node.wait(30)
        self.node.stdout.close()

    def __call__(self, cases):
        """Return the instructions of cases, pairs of numbers and what is known."""
        self.node.stdin.write(json.dumps(list(cases)) + "\n")
        self.node.stdin.flush()
        return json.loads(self.node.stdout.readline())

    def words(self, cases):
        return [one["word"] for one in self(cases)]
