"""Quantiles of the standard normal distribution."""

Z95 = 1.6449  # 95 %: of a normal variable, 5 … 95 % lie within ± Z95 standard deviations
Z99 = 2.3263  # 99 %
