"""What `tombo diagnose` answers about logs as they are read, without its command line."""

from __future__ import annotations

from collections.abc import Sequence

from tombo_bag.flight import Flight
from tombo_diagnosis.change.diagnose import NEEDED, diagnose_change
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose import check_flights, diagnose_unchecked
from tombo_diagnosis.flight.nominal import NominalModel, nominal_model


def diagnosed(logs: Sequence[Flight], nominal: NominalModel) -> Diagnosis:
    """Check flights and diagnose them.

    Raises:
        InputError: none of them can be used.
    """
    return diagnose_unchecked(logs, nominal)[0]


def against_healthy(new: Sequence[Flight], healthy: Sequence[Flight]) -> Diagnosis:
    """Check new and healthy flights, and say what has changed.

    Args:
        new: flights in one new state.
        healthy: flights of the same vehicle before.

    Raises:
        InputError: no flight of one side can be used.
    """
    (after, faults), (before, more) = (check_flights(s, needed=NEEDED) for s in (new, healthy))
    nominal, refused = nominal_model(), [*faults, *more]
    return diagnose_change(after, before, nominal, left_out=refused)[0]
