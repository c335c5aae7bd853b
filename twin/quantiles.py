"""Quantiles of the standard normal distribution and of Student's."""

Z95 = 1.6449  # 95 %: of a normal variable, 5 … 95 % lie within ± Z95 standard deviations
Z99 = 2.3263  # 99 %


def student95(freedom: float) -> float:
    """The 95 % quantile of Student's distribution of 3 degrees of freedom or more, within 0.007 (from 5 on: 0.001).

    Source   M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions (1964), 26.7.5
    """
    z, ν = Z95, freedom
    return (
        z
        + (z**3 + z) / (4 * ν)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * ν**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * ν**3)
    )
