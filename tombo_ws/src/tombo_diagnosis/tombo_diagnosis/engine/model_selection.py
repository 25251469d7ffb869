"""The search for causes: which effects, alone or up to three together, explain the data.

Every candidate is first judged by the tangent about the best explanation so far, the promising
ones then by the model itself. An explanation grows as long as another cause is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tombo_diagnosis.engine.model import Explanation, Hypothesis, RegressionModel, SearchResult
from tombo_diagnosis.engine.regression import NOMINAL_WIDTHS, TIGHT, Fit, solve
from tombo_dynamics.arrays import Array

LOG_BF_FIRST = 3.5
"""Log Bayes factor with which a cause is accepted; its effect is in docs/diagnosis.md."""
LOG_BF_ADDITIONAL = 7.0
"""The same for a further cause: two at once are rarer."""
_MIN_TANGENT_LOG_BF = 1.5
_MIN_RELATIVE_GAIN = 0.2
"""A candidate with less than this share of the best linearised log Bayes factor is skipped."""
_MAX_TIGHT_REFITS = 2
_STRETCHED_SIGMAS = 3.0
_BEAM_WIDTH = 2
"""Number of explanations that each step of the search extends."""
MAX_CAUSES = 3
"""Causes that an explanation may have."""
_RELINEARIZE_LOG_BF = 25.0
"""Above this evidence the slopes of the nominal model are not accurate enough."""
_RELINEARIZE_WITHIN_LOG_BF = 10.0
"""Explanations so close to the best one are compared with it with slopes of their own."""
_WIDTH_FACTORS = np.geomspace(1.5, 40.0, 10)
"""Factors on the width of a stochastic effect that are tried."""


def search(
    model: RegressionModel, progress: Callable[[float], None] | None = None, most: int = MAX_CAUSES
) -> SearchResult:
    """Return the best explanation of the data and its alternatives."""
    null = Explanation((), model.null_hypothesis, 0.0)
    single_log_bf = {h.effect: gain for gain, h in reversed(rank_hypotheses(model, null))}
    beam = [null]
    evaluated: dict[frozenset[str], Explanation] = {}
    for size in range(1, most + 1):
        grown: dict[frozenset[str], Explanation] = {}
        for explanation in beam:
            for hypothesis in _worth_fitting(model, explanation):
                fitted = fit_hypotheses(
                    model, (*explanation.hypotheses, hypothesis), explanation.fit
                )
                key = frozenset(fitted.effects)
                if key not in grown or grown[key].evidence < fitted.evidence:
                    grown[key] = fitted
        if progress is not None:
            progress(size / most)
        evaluated.update(grown)
        least = beam[0].evidence + (LOG_BF_FIRST if size == 1 else LOG_BF_ADDITIONAL)
        promising = [e for e in _likeliest_first(grown.values()) if e.evidence > least]
        if not promising:
            break
        beam = [
            _relinearized(model, e) if e.evidence >= _RELINEARIZE_LOG_BF else e
            for e in promising[:_BEAM_WIDTH]
        ]
    best = beam[0]
    for explanation in evaluated.values():
        if len(explanation.effects) == 1 and math.isfinite(explanation.evidence):
            single_log_bf[explanation.effects[0]] = explanation.evidence
    members = frozenset(best.effects)
    alternatives = [e for k, e in evaluated.items() if len(k) == len(members) and k != members]
    if best.hypotheses:
        nearest = _relinearize_near_best(model, [best, *alternatives])
        best, *alternatives = _against_null_alike(model, nearest)
    known = {key: e.evidence for key, e in evaluated.items()}
    return SearchResult(
        free_all_axes(model, best), single_log_bf, tuple(_likeliest_first(alternatives)), known
    )


def _likeliest_first(explanations: Iterable[Explanation]) -> list[Explanation]:
    return sorted(explanations, key=lambda e: -e.evidence)


def _worth_fitting(model: RegressionModel, explanation: Explanation) -> list[Hypothesis]:
    """Return the hypotheses to add to an explanation: the best two ways of each effect.

    At most `Setting.max_fitted` effects, best first; then the best with tight priors.
    """
    ranked = rank_hypotheses(model, explanation)
    promising = [(gain, h) for gain, h in ranked if gain > _MIN_TANGENT_LOG_BF]
    counts: dict[str, int] = {}
    chosen = []
    first = promising[0][0] if promising else 0.0
    for gain, hypothesis in promising:
        counts[hypothesis.effect] = counts.get(hypothesis.effect, 0) + 1
        several = counts[hypothesis.effect] > 1
        close = gain > first - 3.0 if several else gain > _MIN_RELATIVE_GAIN * first
        if counts[hypothesis.effect] <= 2 and close and len(counts) <= model.setting.max_fitted:
            chosen.append(hypothesis)
    chosen += [h for _, h in ranked if h.effect in model.setting.always_fitted and h not in chosen]
    return chosen + _with_tight_priors(model, explanation)


def _with_tight_priors(model: RegressionModel, explanation: Explanation) -> list[Hypothesis]:
    """Return what looks best with tolerances held, where some are far outside their tolerance."""
    fit = explanation.fit
    unknowns = model.unknowns
    limits = unknowns.deviations(fit.free, fit.prior_std_scale)
    stretched = np.abs(fit.solution.mean - fit.prior_mean) > _STRETCHED_SIGMAS * limits
    places = [
        k
        for k, i in enumerate(unknowns.indices)
        if i in unknowns.identifiable and i not in fit.free
    ]
    if not stretched[places].any():
        return []
    best: dict[str, Hypothesis] = {}
    for gain, hypothesis in rank_hypotheses(model, explanation, TIGHT):
        if gain > _MIN_TANGENT_LOG_BF and hypothesis.free:
            best.setdefault(hypothesis.effect, hypothesis)
    return list(best.values())[:_MAX_TIGHT_REFITS]


def rank_hypotheses(
    model: RegressionModel, explanation: Explanation, tight: float = 1.0
) -> list[tuple[float, Hypothesis]]:
    """Return every hypothesis of every effect with its gain over an explanation, by the tangent.

    `tight` is a factor on the tolerances.
    """
    fit, unknowns = explanation.fit, model.unknowns
    held = unknowns.deviations(fit.free, fit.prior_std_scale, tight, fit.pinned)
    base = solve(fit.normal, held, fit.prior_mean, covariance=False).evidence
    confounded = model.setting.confounded_with
    excluded = {*explanation.effects}.union(*(confounded.get(e, ()) for e in explanation.effects))
    ranked = []
    for effect in unknowns.effects:
        for free in unknowns.variants[effect] if effect not in excluded else ():
            pinned = [place for place in fit.pinned if unknowns.indices[place] not in free]
            deviations = unknowns.deviations(
                (*fit.free, *free), fit.prior_std_scale, tight, pinned
            )
            solution = solve(fit.normal, deviations, fit.prior_mean, covariance=False)
            gain = solution.evidence - base
            if gain > _MIN_TANGENT_LOG_BF:
                gain -= _healthy_gain(model, fit, free, tight)
            if gain > _MIN_TANGENT_LOG_BF and unknowns.outside(fit.theta, free, solution.mean):
                solution = solve(fit.normal, deviations, fit.prior_mean)
                gain -= unknowns.bounds_penalty(fit.theta, free, solution)
            ranked.append((gain - _multiplicity_penalty(model, effect), Hypothesis(effect, free)))
    ranked += [
        _widest(model, explanation, effect, price, tight)
        for effect, price in model.noise_effects().items()
        if effect not in excluded
    ]
    return sorted(ranked, key=lambda each: -each[0])


def _widest(
    model: RegressionModel, explanation: Explanation, effect: str, price: float, tight: float
) -> tuple[float, Hypothesis]:
    """Return a stochastic effect by its most probable width, and its gain.

    A broad prior over the width: the gain is the mean over the grid, not its best.
    """
    fit = explanation.fit
    base = model.evidence_with(fit, fit.prior_std_scale, tight)
    gains = [
        model.evidence_with(fit, {**fit.prior_std_scale, effect: float(width)}, tight) - base
        for width in _WIDTH_FACTORS
    ]
    mean = float(np.logaddexp.reduce(gains)) - math.log(len(gains)) - price
    mean -= model.setting.log_prior_cost
    mean -= _healthy_gain(model, fit, (), tight, {effect: 1.0})
    return mean, Hypothesis(effect, (), float(_WIDTH_FACTORS[int(np.argmax(gains))]))


def fit_hypotheses(
    model: RegressionModel, hypotheses: tuple[Hypothesis, ...], start: Fit | None = None
) -> Explanation:
    """Fit a set of causes with the model itself, from `start` (None: the nominal model)."""
    null = model.null_hypothesis
    free = tuple(dict.fromkeys(i for each in hypotheses for i in each.free))
    prior_std_scale = {each.effect: each.width for each in hypotheses if each.width is not None}
    fit = model.fit(free, prior_std_scale, start or null)
    evidence = _beyond_healthy(model, fit) - null.evidence
    evidence -= sum(_multiplicity_penalty(model, each.effect) for each in hypotheses)
    evidence -= sum(
        math.log(_WIDTH_FACTORS.size) - 1.0 + model.noise_effects()[e] for e in prior_std_scale
    )
    for each in hypotheses:
        if each.free and all(fit.theta[i] == model.theta[i] for i in each.free):
            evidence = -math.inf  # at the edge of its bounds it does nothing: no cause
    return Explanation(hypotheses, fit, evidence)


def _beyond_healthy(model: RegressionModel, fit: Fit) -> float:
    """Return the log evidence of a fit, less what bounds and sizes that may be healthy cost."""
    gain = _healthy_gain(model, fit, fit.free, prior_std_scale=fit.prior_std_scale)
    beyond = model.unknowns.bounds_penalty(fit.theta, fit.free, fit.solution, fitted=True)
    return fit.evidence - beyond - gain


def _healthy_gain(
    model: RegressionModel,
    fit: Fit,
    free: Sequence[int],
    tight: float = 1.0,
    prior_std_scale: Mapping[str, float] = NOMINAL_WIDTHS,
) -> float:
    """Return the log evidence that sizes which may be healthy add to no cause at all.

    How far a vehicle's parameters vary from flight to flight is known from few flights. A cause
    has to be more probable than that its own tolerance is too small, and than that all are. By
    the tangent of a fit.

    Args:
        model: the regression.
        fit: whose tangent is used; what else it has free stays so.
        free: places in theta of the causes.
        tight: factor on the tolerances.
        prior_std_scale: stochastic effects among the causes.
    """
    unknowns = model.unknowns
    doubts = {p.index for p in unknowns.parameters if p.tolerance_inflation > 1.0}
    if not doubts:
        return 0.0
    held = tuple(i for i in fit.free if i not in free)
    kept = {e: w for e, w in fit.prior_std_scale.items() if e not in prior_std_scale}
    pinned = {*fit.pinned, *(model.null_hypothesis.pinned if not held else ())}
    released = [place for place in pinned if unknowns.indices[place] not in free]
    every = dict.fromkeys((*prior_std_scale, *unknowns.draws), unknowns.draw_inflation)
    own = dict.fromkeys(prior_std_scale, unknowns.draw_inflation)

    def evidence(deviations: Array) -> float:
        return solve(fit.normal, deviations, fit.prior_mean, covariance=False).evidence

    before = evidence(unknowns.deviations(held, kept, tight, sorted(pinned)))
    after = max(
        evidence(unknowns.deviations(held, {**loose, **kept}, tight, released, doubted))
        for doubted, loose in ((doubts.intersection(free), own), (doubts, every))
    )
    return max(after - before, 0.0)


def restrict_to(
    model: RegressionModel, explanation: Explanation, effects_kept: Sequence[str]
) -> Explanation:
    """Return an explanation with some of its causes only, fitted again."""
    remaining = [each for each in explanation.hypotheses if each.effect in effects_kept]
    if len(remaining) == len(explanation.hypotheses):
        return explanation
    result = Explanation((), model.null_hypothesis, 0.0)
    for hypothesis in remaining:
        result = fit_hypotheses(model, (*result.hypotheses, hypothesis), result.fit)
    return result


def _relinearized(model: RegressionModel, explanation: Explanation) -> Explanation:
    """Return an explanation with all slopes taken where it is, and its evidence then."""
    if explanation.relinearized or not math.isfinite(explanation.evidence):
        return explanation
    fit = model.relinearized(explanation.fit)
    evidence = explanation.evidence + _beyond_healthy(model, fit)
    evidence -= _beyond_healthy(model, explanation.fit)
    return replace(explanation, fit=fit, evidence=evidence, relinearized=True)


def _relinearize_near_best(
    model: RegressionModel, explanations: list[Explanation]
) -> list[Explanation]:
    """Return explanations, most probable first; those close to the first are relinearized.

    With slopes of its own one may fall far behind others; then these get their own, too.
    """
    rough, done = explanations, list[Explanation]()
    while True:
        top = max(e.evidence for e in (*rough, *done))
        near = [e for e in rough if e.evidence > top - _RELINEARIZE_WITHIN_LOG_BF]
        if not near:
            return _likeliest_first((*rough, *done))
        done += [_relinearized(model, e) for e in near]
        rough = [e for e in rough if e not in near]


def _against_null_alike(
    model: RegressionModel, explanations: list[Explanation]
) -> list[Explanation]:
    """Return explanations with their evidence against a nominal model whose slopes are as theirs.

    New slopes change the evidence of the nominal model as well. It counts where the first would
    hardly be accepted, or hardly not.
    """
    first = explanations[0]
    if not first.relinearized or first.evidence >= _RELINEARIZE_LOG_BF:
        return explanations
    null = model.null_hypothesis
    change = model.relinearized(null).evidence - null.evidence
    return [replace(e, evidence=e.evidence - change) for e in explanations]


def free_all_axes(model: RegressionModel, explanation: Explanation) -> Explanation:
    """Return an explanation with every parameter of a named unit free: all axes of a bias or wind.

    An axis whose part was too small to be accepted is measured all the same.
    """
    unknowns = model.unknowns
    hypotheses = []
    for hypothesis in explanation.hypotheses:
        freed = [unknowns.parameters[i] for i in hypothesis.free]
        free = hypothesis.free
        if freed and freed[0].low < freed[0].null < freed[0].high:
            units = {p.unit for p in freed}
            free = tuple(
                p.index
                for p in unknowns.parameters
                if p.effect == hypothesis.effect
                and p.unit in units
                and p.index in unknowns.identifiable
            )
        hypotheses.append(replace(hypothesis, free=free))
    if tuple(hypotheses) == explanation.hypotheses:
        return explanation
    every = tuple(dict.fromkeys(i for each in hypotheses for i in each.free))
    fit = model.fit(every, explanation.fit.prior_std_scale, explanation.fit)
    return replace(explanation, hypotheses=tuple(hypotheses), fit=fit)


def _multiplicity_penalty(model: RegressionModel, effect: str) -> float:
    """Return the log of an effect's number of hypotheses: many don't make it more probable.

    And what any cause costs where causes are rare.
    """
    return (
        math.log(max(1, len(model.unknowns.variants.get(effect, ()))))
        + model.setting.log_prior_cost
    )
