"""When something in a recording is likely a mistake: limits that clean recordings do not reach."""

from __future__ import annotations

from dataclasses import dataclass

from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelThresholds:
    """Levels of accelerometers and torque meters."""

    gravity: float = deciding(
        0.02, meaning="relative distance of a mean from gravity in another unit",
        source="not derived: twice the usual tolerance of a sensor's sensitivity, 1 %",
    )  # fmt: skip
    least: float = deciding(
        1e-4, unit="m/s²", meaning="least RMS of an accelerometer on a turning machine",
        source="not derived: 10 µg, below the noise of vibration sensors over a band of 1 kHz",
    )  # fmt: skip
    most: float = deciding(
        5000.0, unit="m/s²", meaning="largest RMS of an accelerometer on a gearbox",
        source="not derived: 500 g, the range of usual vibration sensors, as an RMS",
    )  # fmt: skip
    thousandth: float = deciding(
        1 / 300, of="median RMS of the other accelerometers", meaning="RMS that is a thousandth of it, or its inverse",
        source="derivation: a factor of 1000, with one of 3.3 for the sensor's place",
    )  # fmt: skip
    least_others: int = deciding(
        2, meaning="other accelerometers that a level is compared with", source="derivation: two agree against one"
    )
    offset: float = deciding(
        20.0, of="RMS of the vibration", meaning="mean of an accelerometer from which it is an offset",
        source="not derived: an offset that uses up more than nine tenths of a range of twice the mean",
    )  # fmt: skip
    least_torque: float = deciding(
        0.2, of="stated torque", meaning="negative mean torque from which the polarity is in question",
        source="not derived: above the friction and the offset of a torque meter",
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedThresholds:
    """Tooth counts, encoders and the mesh lines."""

    ratio: float = deciding(
        0.003, meaning="relative distance of the encoders' ratio from the one of a mistake",
        source="not derived: tooth counts of pairs in use differ by more",
    )  # fmt: skip
    absent: float = deciding(
        6.0, unit="dB",
        meaning="mean height of mesh lines over those of the neighbouring shaft orders, below "
        "which another tooth count is looked for",
        source="derivation: four lines of noise are as high in 1 of 500 cases",
    )  # fmt: skip
    clear: float = deciding(
        15.0, unit="dB", meaning="mean height from which another tooth count or speed is named",
        source="not derived: chosen; none is named wrongly in D00–D13 and the bundled recordings",
    )  # fmt: skip
    part_power: float = deciding(
        0.01, of="power of the first mesh line", meaning="power of a line at half, a third or a quarter of it",
        source="not derived: 20 dB below",
    )  # fmt: skip
    clear_line: float = deciding(
        10.0, unit="dB", meaning="height of each of three harmonics of that tooth count",
        source="not derived: chosen; none is named wrongly in D00–D13 and the bundled recordings",
    )  # fmt: skip
    tonal: float = deciding(
        40.0, unit="dB", meaning="height over the noise floor of the strongest line, from which the mesh must be seen",
        source="not derived: chosen; a machine without load may show no mesh line in its noise",
    )  # fmt: skip
    no_line: float = deciding(
        13.0, unit="dB", meaning="height over the noise floor below which a mesh line is not there",
        source="derivation: noise exceeds 20 times its median power in one of 10^6 lines",
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplingThresholds:
    """Aliasing, clocks of channels, and mains hum."""

    folded: float = deciding(
        8.0, of="noise between the lines", meaning="amplitude of a mesh line folded at half the sampling rate",
        source="derivation: noise exceeds it in less than one of 10^13 lines",
    )  # fmt: skip
    folded_share: float = deciding(
        0.02, of="strongest mesh line", meaning="the same", source="not derived: what a filter of 34 dB leaves"
    )
    least_folded: int = deciding(
        2, meaning="folded mesh lines", source="not derived: one may be a tone of another machine"
    )
    least_shift: float = deciding(
        0.02, unit="s", meaning="shift of a channel in time",
        source="derivation: the delay of a resonance is 1/(ζω), 4 ms at 5 % damping and 767 Hz; five times that",
    )  # fmt: skip
    shift_deviations: float = deciding(
        5.0, unit="standard deviations", meaning="the same", source="convention: five standard deviations"
    )
    shift_explains: float = deciding(
        0.5,
        meaning="share of the variance of the mesh phase that a shift explains",
        source="not derived: the larger part",
    )
    hum: float = deciding(
        0.1, of="RMS of the channel", meaning="amplitude of tones at multiples of 50 or 60 Hz that are named",
        source="not derived: chosen",
    )  # fmt: skip
    mains: float = deciding(
        0.2, unit="Hz", meaning="distance of a tone from 50 or 60 Hz up to which it may be the mains",
        source="convention: large grids leave it for minutes a year (continental Europe: standard deviation 0.02 Hz)",
    )  # fmt: skip
    stated_speed: float = deciding(
        0.01, of="stated speed", meaning="how far a speed that was stated and not measured may be off",
        source="not derived: half of the usual slip of an induction motor",
    )  # fmt: skip
    stated_multiples: int = deciding(
        6, meaning="multiples of a stated speed that excuse a tone",
        source="derivation: at the sixth, the doubt of the speed covers an eighth of the distance between multiples",
    )  # fmt: skip
    most_parts: int = deciding(
        8, meaning="lowest speed, as a part of the tone's frequency, whose other multiples are looked for",
        source="not derived: at an eighth of 50 Hz, a shaft turns at 6 Hz",
    )  # fmt: skip
    comb: float = deciding(
        0.6, of="other multiples of that speed", meaning="share that must be there for the tone to be that of a shaft",
        source="not derived: chance makes none of them",
    )  # fmt: skip
    hum_line: float = deciding(
        20.0, unit="dB", meaning="height over the noise floor of such a tone",
        source="derivation: noise exceeds 100 times its median power in less than one of 10^30 lines",
    )  # fmt: skip
