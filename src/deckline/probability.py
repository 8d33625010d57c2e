"""Tails of the normal and chi-square distributions; `scipy.stats` takes a hundred times as long for one number."""

from scipy.special import chdtrc, chdtri, ndtr, ndtri


def normal_tail(x: float) -> float:
    """Probability that a standard normal number exceeds x."""
    return float(ndtr(-x))


def two_sided_quantile(risk: float) -> float:
    """Size that a standard normal number exceeds, either way, with this probability."""
    return float(-ndtri(risk / 2))


def chi2_tail(x: float, degrees: int) -> float:
    """Probability that a chi-square number of so many degrees of freedom exceeds x."""
    return float(chdtrc(degrees, x))


def chi2_gate(sigma: float, degrees: int) -> float:
    """Chi-square value that is as improbable as a normal number beyond `sigma` 1-sigma, either way."""
    return float(chdtri(degrees, 2 * ndtr(-sigma)))
