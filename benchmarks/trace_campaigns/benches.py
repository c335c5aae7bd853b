"""The machines that campaigns are made on: the reference rig and two others, and what is drawn for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent / "rigs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """One machine: rig file, ranges of its operating condition, and what its wear was found to be."""

    rig: Path
    asset: str
    accelerometer: str
    teeth: tuple[int, int]
    speed: tuple[float, float]  # of the operating condition [Hz]
    torque: tuple[float, float]  # [N·m]
    fastest: float  # that a second condition goes to [Hz]
    reference: tuple[float, float, float, float]  # k [m²/N], revolutions, torque [N·m] and the depth they wear [µm]
    first_mode: float  # torsional [Hz]
    load: float = 1.0  # rated torque against the reference rig's, by which torques among the sizes are larger
    force: float = 1.0  # the same of the mesh force, for forces
    reaction: float = 12.5  # (1 + z2/z1)/span of a housing's feet: unloading of a foot for a torque [1/m]

    @property
    def rated_torque(self) -> float:
        return 10.0 * self.load


BENCHES: Mapping[str, Bench] = {
    "unsw": Bench(
        rig=ROOT / "recordings" / "rigs" / "unsw.toml",
        asset="unsw-rig",
        accelerometer="y6",
        teeth=(19, 52),
        speed=(9.0, 16.0),
        torque=(8.0, 15.0),
        fastest=17.0,
        reference=(1.2e-12, 9000.0, 10.0, 46.7),
        first_mode=21.8,
    ),
    "pump": Bench(
        rig=HERE / "pump-drive.toml",
        asset="pump-drive",
        accelerometer="y9",
        teeth=(20, 40),
        speed=(6.0, 12.0),
        torque=(22.0, 40.0),
        fastest=13.0,
        reference=(1.2e-12, 9000.0, 30.0, 97.4),
        first_mode=17.1,
        load=3.0,
        force=2.28,
        reaction=10.0,
    ),
    "spindle": Bench(
        rig=HERE / "spindle-drive.toml",
        asset="spindle-drive",
        accelerometer="y4",
        teeth=(23, 67),
        speed=(13.0, 22.0),
        torque=(6.0, 11.0),
        fastest=24.0,
        reference=(1.2e-12, 9000.0, 8.0, 41.1),
        first_mode=25.8,
        load=0.8,
        force=0.88,
        reaction=13.0,
    ),
}
