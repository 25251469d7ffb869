"""Whether nodes in lockstep over DDS and the headless flight fly the same flight, to the last bit.

    python lockstep_equality.py runs/equality            # five scenarios, ten seeds
    python lockstep_equality.py runs/equality --seeds 0:2 hover survey

Each flight is flown twice by `tombo fly` and compared on the topics that decide it, by header
stamp and every field; receive times are left out. A line for each is added to equality.jsonl in
the folder; flights that have theirs are skipped, so the command can be started again. Exit code 1:
flights differ.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tombo_bag.message_codec import MessageCodec, messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import TOPICS

SCENARIOS = ("paper_collision", "hover", "known_obstacle", "rigid_propeller", "survey")
COMPARED = (
    "/collision_event",
    "/reaction/status",
    "/setpoint",
    "/mission/status",
    "/rotor_command",
)


def messages(bag: Path, topic: str) -> list[bytes]:
    """Return a topic's messages as bytes of their fields, header stamp and frame included."""
    typename = TOPICS[topic].typename
    codec = MessageCodec(typename)
    with Recording(bag) as recording:
        stream = recording.topics.get(topic)
        if stream is None or not stream.count:
            return []
        return [
            codec.encode(message) for message in messages_of(typename, recording.columns(topic))
        ]


def first_difference(a: list[bytes], b: list[bytes]) -> int | None:
    """Return the number of the first message that differs; None: none does."""
    if a == b:
        return None
    pairs = enumerate(zip(a, b, strict=False))
    return next((i for i, (x, y) in pairs if x != y), min(len(a), len(b)))


def fly(scenario: str, seed: int, output: Path, more: list[str]) -> float:
    """Fly into a folder; return how long it took [s]."""
    began = time.monotonic()
    command = [str(Path(sys.executable).with_name("tombo")), "fly", scenario, "--seed", str(seed)]
    subprocess.run([*command, *more, "-o", str(output), "--force", "--json"], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    return time.monotonic() - began


def examine(scenario: str, seed: int, folder: Path, settings: list[str]) -> dict[str, object]:
    """Fly both ways and compare."""
    a, b = folder / f"{scenario}-{seed}-nodes", folder / f"{scenario}-{seed}-headless"
    sets = [word for setting in settings for word in ("--set", setting)]
    row: dict[str, object] = {"scenario": scenario, "seed": seed}
    row["nodes_s"] = round(fly(scenario, seed, a, ["--nodes", "--lockstep", *sets]), 1)
    row["headless_s"] = round(fly(scenario, seed, b, sets), 1)
    differing = {}
    for topic in COMPARED:
        flown = [messages(path / "flight.mcap", topic) for path in (a, b)]
        at = first_difference(*flown)
        row[topic] = len(flown[0])
        if at is not None:
            differing[topic] = at
    row["first_differences"] = differing
    if not differing:
        shutil.rmtree(a)
        shutil.rmtree(b)
    return row


def main() -> None:
    """Fly what has not been flown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--seeds", default="0:10", help="A:B means A to B-1")
    parser.add_argument("--set", action="append", default=[], help="as of `tombo fly`")
    chosen = parser.parse_args()
    first, last = map(int, chosen.seeds.split(":"))
    chosen.folder.mkdir(parents=True, exist_ok=True)
    results = chosen.folder / "equality.jsonl"
    rows = (
        [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    )
    done = {(row["scenario"], row["seed"]): row for row in rows}
    for scenario in chosen.scenarios:
        for seed in range(first, last):
            if (scenario, seed) not in done:
                row = done[scenario, seed] = examine(scenario, seed, chosen.folder, chosen.set)
                with results.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                sys.stdout.write(json.dumps(row) + "\n")
                sys.stdout.flush()
    different = [key for key, row in done.items() if row["first_differences"]]
    sys.stdout.write(f"{len(done)} flights, {len(different)} differ: {different}\n")
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
