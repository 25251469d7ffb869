"""Workers that read damaged files, each watched: the time of a file is limited, and its memory."""

from __future__ import annotations

import dataclasses
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .samples import ROOT, Sample

_PATIENCE_S = 120.0
"""For one file on a busy machine; a worker ends by itself after `SECONDS` of a core."""
_START_S = 240.0
"""For a worker to import what it needs; compiled code may have to be made."""
_CASES = 500
"""Files that a worker reads before a new one takes its place."""


@dataclass(frozen=True)
class Fault:
    """A file that was neither read nor refused."""

    sample: str
    seed: int
    why: str


@dataclass
class Outcome:
    """What came of all files."""

    accepted: int = 0
    refused: int = 0
    faults: list[Fault] = field(default_factory=list)
    longest_s: float = 0.0
    longest: str = ""
    tell: Callable[[str], None] = lambda text: None
    """Called with each fault as it is found."""


class Worker:
    """A process that damages and reads files, one at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._process: subprocess.Popen[bytes] | None = None
        self._cases = 0

    def ask(self, sample: Sample, seed: int) -> tuple[dict[str, Any], float]:
        """Return what it says of a damaged file, and the time that it took [s]."""
        if self._process is None or self._cases >= _CASES:
            self.close()
            self._start()
        self._cases += 1
        assert self._process is not None and self._process.stdin is not None
        plain = dataclasses.asdict(sample) | {"path": str(sample.path)}
        self._process.stdin.write(json.dumps({"sample": plain, "seed": seed}).encode() + b"\n")
        self._process.stdin.flush()
        began = time.monotonic()
        answer = self._line(_PATIENCE_S)
        return answer, time.monotonic() - began

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _start(self) -> None:
        command = [sys.executable, "-m", "tests.fuzz.judge", str(self._folder)]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL
        )
        self._cases = 0
        first = self._line(_START_S)
        if first:
            raise RuntimeError(f"a worker can't start: {first}")

    def _line(self, patience_s: float) -> dict[str, Any]:
        assert self._process is not None and self._process.stdout is not None
        there, _, _ = select.select([self._process.stdout], [], [], patience_s)
        line = self._process.stdout.readline() if there else b""
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        why = f"no answer in {patience_s:g} s"
        if there:
            why = f"it ended with {self._process.wait()}"
        self.close()
        return {"wrong": why}


def fuzz(
    samples: Sequence[Sample],
    seeds: Iterable[int],
    workers: int,
    folder: str,
    tell: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Damage one sample by each seed, in turn, and read it; `tell` is called with each fault."""
    done, lock = Outcome(tell=tell), threading.Lock()
    whole: dict[str, dict[str, int]] = {}
    cases = iter([(seed, samples[seed % len(samples)]) for seed in seeds])

    def work(number: int) -> None:
        worker = Worker(Path(folder) / f"worker_{number}")
        try:
            while True:
                with lock:
                    case = next(cases, None)
                if case is None:
                    return
                seed, sample = case
                answer, seconds = worker.ask(sample, seed)
                with lock:
                    _note(done, whole, sample, seed, answer, seconds)
        finally:
            worker.close()

    threads = [threading.Thread(target=work, args=(i,)) for i in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return done


def _note(
    done: Outcome,
    whole: dict[str, dict[str, int]],
    sample: Sample,
    seed: int,
    answer: dict[str, Any],
    seconds: float,
) -> None:
    if seconds > done.longest_s:
        done.longest_s, done.longest = seconds, f"{sample.name}, seed {seed}"
    why = answer.get("wrong", "")
    if "counts" in answer and answer["payload"] and not why:
        from tombo_bag.recording import Recording

        if sample.name not in whole:
            with Recording(sample.path) as recording:
                whole[sample.name] = {n: s.count for n, s in recording.topics.items()}
        if answer["counts"] != whole[sample.name]:
            why = f"other topics or counts after a change of payload alone: {answer['counts']}"
    if why:
        done.faults.append(Fault(sample.name, seed, why))
        done.tell(f"--- {sample.name}, seed {seed}: {why}")
    elif "counts" in answer:
        done.accepted += 1
    else:
        done.refused += 1
