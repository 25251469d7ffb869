"""What a reader may do with a damaged file: answer, or refuse it by an `InputError` of one line.

`python -m tests.fuzz.judge FOLDER` is a worker: a line of JSON says what to damage and read, a
line answers. Its memory is limited; who asks keeps the time.
"""

from __future__ import annotations

import json
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tombo_bag.comparison import compare_recordings
from tombo_bag.recording import Recording
from tombo_collision.network import read_network
from tombo_diagnosis.stand.model_file import read_stand_model
from tombo_diagnosis.stand.tables.assemble import assemble
from tombo_diagnosis.stand.tables.table_reader import load_mapping as load_stand_mapping
from tombo_diagnosis.stand.tables.table_reader import read_stand
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.library import read_library
from tombo_flight.model_file import read_model
from tombo_flight.recorded_flight import read_flight
from tombo_flight.replay.recorded import scenario_of_bag
from tombo_flight.replay.run import ReplayRequest, replay_bag
from tombo_flight.scenario import load_scenario
from tombo_flight.vehicle_file import read_vehicle
from tombo_logs.checks.pipeline import check_log
from tombo_logs.proposal.explain import explain_mapping
from tombo_logs.readers.csv_mapping import load_mapping
from tombo_logs.readers.log_reader import read_log
from tombo_propeller.rotor_trace import read_trace

from .mutate import mutated
from .samples import FLIGHT, Sample

SECONDS = 10.0
"""Of a core, for all readers of one file."""
MEMORY = 1_000_000_000
"""Bytes that reading one file may take beyond what the program itself does."""
LONGEST = 5000
"""Characters of an error."""

Counts = dict[str, int]


def _recording(path: Path, original: Path) -> Counts:
    with Recording(path) as recording:
        counts = {name: stream.count for name, stream in recording.topics.items()}
        recording.load(list(recording.topics))
        for name in recording.topics:
            _tried(lambda name=name: recording.columns(name))
            _tried(lambda name=name: recording.messages(name))
        metadata, _ = recording.metadata, recording.damage
    _tried(lambda: scenario_of_bag(metadata))
    _tried(lambda: check_log(read_log(path, "x")))
    _tried(lambda: explain_mapping(path))
    _tried(lambda: read_flight(path))
    _tried(lambda: compare_recordings(path, original))
    _tried(lambda: replay_bag(path, ReplayRequest()))
    return counts


def _folder(path: Path, original: Path) -> Counts:
    target = path.parent / next(original.parent.glob("*.db3")).name
    if not target.exists():
        target.symlink_to(next(original.parent.glob("*.db3")))
    described = path.parent / "metadata.yaml"
    path.replace(described)
    with Recording(path.parent) as recording:
        recording.columns(next(iter(recording.topics)))
    return {}


def _log(path: Path, original: Path) -> Counts:
    _tried(lambda: explain_mapping(path))
    check_log(read_log(path, "x"))
    return {}


def _stand(path: Path, original: Path) -> Counts:
    assemble([read_stand(path)], 6, "published")
    return {}


def _library(path: Path, original: Path) -> Counts:
    folder = path.parent / "library"
    folder.mkdir(exist_ok=True)
    for other in folder.iterdir():
        other.unlink()
    path.replace(folder / original.name)
    read_library(folder)
    return {}


def _mapping(path: Path, original: Path) -> Counts:
    mapping = load_mapping(path)
    _tried(lambda: check_log(read_log(original.parent / "flight.csv", "x", mapping)))
    _tried(lambda: read_log(original.parent / "log.mcap", "x", mapping))
    _tried(lambda: read_log(original.parent / "flight.ulg", "x", mapping))
    return {}


def _reads(reader: Callable[[Any], Any]) -> Callable[[Path, Path], Counts]:
    def read(path: Path, original: Path) -> Counts:
        reader(path)
        return {}

    return read


READERS: dict[str, Callable[[Path, Path], Counts]] = {
    "recording": _recording,
    "folder": _folder,
    "log": _log,
    "stand": _stand,
    "trace": _reads(read_trace),
    "vehicle": _reads(lambda path: read_vehicle(str(path))),
    "policy": _reads(lambda path: read_network("network", str(path))),
    "scenario": _reads(lambda path: load_scenario(str(path))),
    "mapping": _mapping,
    "stand_mapping": _reads(lambda path: load_stand_mapping(str(path))),
    "model": _reads(read_model),
    "stand_model": _reads(read_stand_model),
    "library": _library,
}


def judged(sample: Sample, path: Path) -> dict[str, Any]:
    """Read a file: `counts` where it is accepted, `refused` or what is `wrong`."""
    try:
        return {"counts": READERS[sample.reader](path, sample.path)}
    except InputError as error:
        text = str(error)
        if len(text) > LONGEST or "Traceback" in text:
            return {"wrong": f"an error of {len(text)} characters: {text[:200]}"}
        return {"refused": text[:300]}
    except OSError as error:  # a line on standard error as well
        return {"refused": str(error)[:300]}
    except BaseException:
        return {"wrong": "".join(traceback.format_exc())[-3000:]}


def _tried(read: Callable[[], object]) -> None:
    """Let a reader refuse what another one took."""
    try:
        read()
    except InputError as error:
        if len(str(error)) > LONGEST:
            raise AssertionError(f"an error of {len(str(error))} characters") from error


def _used() -> int:
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[0]) * resource.getpagesize()


def main(folder: Path) -> None:
    """Answer one line for each line that comes."""
    warnings.simplefilter("ignore")
    answers, sys.stdout = sys.stdout, sys.stderr
    replay_bag(
        FLIGHT, ReplayRequest()
    )  # what is imported or compiled late is no part of a reading
    read_vehicle("px4_x500")
    _warm()
    resource.setrlimit(resource.RLIMIT_AS, (_used() + MEMORY, resource.RLIM_INFINITY))
    print("{}", file=answers, flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        sample = Sample(**{**asked["sample"], "path": Path(asked["sample"]["path"])})
        damaged = folder / f"damaged{''.join(sample.path.suffixes[-2:])}"
        payload = mutated(sample.path, damaged, sample.form, asked["seed"])
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # its signal ends the process
        found = judged(sample, damaged)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        print(json.dumps({**found, "payload": payload}), file=answers, flush=True)
        damaged.unlink(missing_ok=True)


def _warm() -> None:
    import bz2
    import lzma

    import lz4.frame
    import scipy.optimize
    import scipy.signal

    _ = bz2, lzma, lz4.frame, scipy.optimize, scipy.signal


if __name__ == "__main__":
    main(Path(sys.argv[1]))
