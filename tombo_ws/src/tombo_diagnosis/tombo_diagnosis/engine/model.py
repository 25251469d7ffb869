"""Interface between the engine and a kind of data (flights, thrust stands), and the results."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from tombo_diagnosis.engine.regression import Fit, Unknowns
from tombo_dynamics.arrays import Array

Calibration = Sequence[tuple[float, float]]
"""(stated, true) probabilities, in growing order; between them a straight line."""


@dataclass(frozen=True)
class Setting:
    """Settings that differ between kinds of data."""

    max_fitted: int
    """Number of effects that are fitted with the model itself at each step of the search."""
    model_error_share: float
    """Share of the disputed evidence that errors of the model itself may cause."""
    calibration: Mapping[str, Calibration]
    """Verdict -> its stated against its true probability, found on other seeds than reported."""
    always_fitted: Collection[str] = ()
    """Effects that the linearised model can't rank: they are always fitted."""
    confounded_with: Mapping[str, Collection[str]] = field(default_factory=dict)
    """Effect -> effects that are not named together with it: one may compensate the other."""
    equivalent: Sequence[frozenset[str]] = ()
    """Groups of effects that the data can't distinguish, whatever their evidence."""
    max_confidence: float = 0.99
    """Highest confidence that is stated."""
    log_prior_cost: float = 0.0
    """Taken from the log Bayes factor of every cause: how improbable each is before the data."""


class RegressionModel(Protocol):
    """The regression of some data about a nominal model; all fits are made from it.

    Flights and thrust stands implement it; search and verdict use nothing else.
    """

    unknowns: Unknowns
    theta: Array
    """Parameters of the nominal model."""
    null_hypothesis: Fit
    """The nominal model, everything within its tolerance."""
    setting: Setting

    def noise_effects(self) -> Mapping[str, float]:
        """Return the stochastic effects whose draws these data can show, each with its price.

        The price is subtracted from its log Bayes factor.
        """
        ...

    def fit(self, free: Sequence[int], prior_std_scale: Mapping[str, float], start: Fit) -> Fit:
        """Fit parameters with the model itself, not only its tangent.

        Args:
            free: places in theta.
            prior_std_scale: stochastic effect -> factor on the standard deviation of its
                draws.
            start: fit to begin from.
        """
        ...

    def relinearized(self, fit: Fit) -> Fit:
        """Return a fit with all slopes taken where it ended, not in the nominal model."""
        ...

    def final(self, fit: Fit) -> Array:
        """Return the parameters that a fit came to."""
        ...

    def evidence_with(
        self, fit: Fit, prior_std_scale: Mapping[str, float], tight: float = 1.0
    ) -> float:
        """Return the log evidence of a fit with other draws' widths, by its tangent."""
        ...


@dataclass(frozen=True)
class Hypothesis:
    """One way in which one effect may be present."""

    effect: str
    free: tuple[int, ...]
    """Places in theta; empty for a stochastic effect."""
    width: float | None = None
    """Factor on its width in the nominal model, of a stochastic effect."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes, fitted."""

    hypotheses: tuple[Hypothesis, ...]
    fit: Fit
    evidence: float
    """Log Bayes factor against the nominal model."""
    relinearized: bool = False
    """Whether all slopes were taken where its fit ended."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes, in the order in which they were found."""
        return tuple(hypothesis.effect for hypothesis in self.hypotheses)


@dataclass(frozen=True)
class SearchResult:
    """Result of the search."""

    best: Explanation
    single_log_bf: dict[str, float]
    """Effect -> log Bayes factor of it alone, by its best hypothesis."""
    alternatives: tuple[Explanation, ...]
    """Other explanations with as many causes, most probable first."""
    evaluated: Mapping[frozenset[str], float] = field(default_factory=dict)
    """Effects -> log Bayes factor of them together, of every explanation that was fitted."""

    def log_bf_of_difference(self, alternative: Explanation) -> float:
        """Return the log Bayes factor of the causes of the best explanation that a rival lacks."""
        shared = frozenset(self.best.effects) & frozenset(alternative.effects)
        return self.best.evidence - self.evaluated.get(shared, 0.0)

    def explaining(self, effect: str) -> Explanation:
        """Return the most probable explanation that an effect is part of; of none the best."""
        return next((e for e in self.alternatives if effect in e.effects), self.best)


@dataclass(frozen=True)
class Remainder:
    """The residual of the best explanation, compared with noise."""

    clean: bool
    """The remainder is known noise."""
    p_unexplained: float
    """Probability that the remainder is more than noise."""
    mostly_explained: bool
    """The best explanation removes most of the excess."""
    noise_log_bf: Mapping[str, float] = field(default_factory=dict)
    """Stochastic effect -> log Bayes factor, where the remainder shows it."""
    imitated: Mapping[str, Collection[str]] = field(default_factory=dict)
    """Stochastic effect -> causes that may be confused with another force, if it is present."""
    clean_where_explained: bool = False
    """The remainder is known noise in every group of channels that the causes concern."""


@dataclass(frozen=True)
class Judgement:
    """The verdict and its causes."""

    verdict: str
    effects: tuple[str, ...]
    """Causes, most probable first; of a set its members."""
    members: tuple[str, ...]
    """Of the set, where the data can't distinguish. Causes named with a set are certain, and one
    of the set is present, too."""
    confidence: float
    each: dict[str, float]
    """Confidence in each effect that was named or is in the set."""


P = TypeVar("P")
R = TypeVar("R", bound=Remainder)


@dataclass(frozen=True, eq=False)
class Analysis(Generic[P, R]):
    """Result of an analysis, before it is written as text."""

    problem: P
    """The data as a `Model`."""
    search: SearchResult
    remainder: R
    judgement: Judgement
