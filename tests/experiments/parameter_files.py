"""Parameter files of plants for which the method's λ are not offered."""

from pathlib import Path

IDEAL = Path(__file__).parents[2] / "plant" / "parameters" / "ideal.toml"


def weak_motors(folder: Path) -> Path:
    """Write the file of a plant with motors of a third of the speed: λ_q = 0.5 s needs all of the voltage."""
    return _written(folder / "weak.toml", "K_m = { value = 2.86", "K_m = { value = 1.0")


def quick_motors(folder: Path) -> Path:
    """Write the file of a plant whose motors have almost no lag: λ_motor = 0.0854 s is more than 4 T_m."""
    return _written(folder / "quick.toml", "T_m = { value = 0.22", "T_m = { value = 0.02")


def _written(file: Path, old: str, new: str) -> Path:
    text = IDEAL.read_text(encoding="utf-8")
    assert text.count(old) == 2  # the plant's motor, and the motor as identified
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file
