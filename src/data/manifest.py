"""The dataset as a whole: where it lies, what it was made from, and whether it is all there.

Every clip stands for itself; ``manifest.json`` is derived from them and from the configuration.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ..atomic import replacing
from ..dotted import differences, replaced, short
from ..errors import UserError, way_out_of
from ..provenance import digest_of
from ..used_code import code_of
from .clip import SUMS, recorded_sums, sha256_of
from .split import Split, held_out_clips

MANIFEST = "manifest.json"
MANIFEST_KEYS = {"scale", "sim", "generator", "packages", "split", "held_out", "clips", "digest"}
PACKAGES = (
    *("torch", "lightning", "torchmetrics", "numpy", "numba"),
    *("pybullet", "pybullet-arm64", "embreex", "pillow"),
)

# These modules, and the towns in use, make a dataset.
GENERATOR, TOWNS = "src.sim.generate", "src.sim.towns"
# Settings of ``sim`` that change no byte of a clip.
NOT_SHAPING = ("workers", "dry_run", "shards", "shard")
# What clips are like, whoever made them.
SHAPE = ("grid", "capture_hz")
# A setting of ``sim`` that came later, and the value with which it is as if it were not there.
OFF = {"town_seeds": 1}


@dataclass(frozen=True)
class DatasetSpec:
    """A dataset's specification: the settings and the code of its generator.

    Of clips that were annotated in somebody's recording, ``source`` says in which and how.
    """

    scale: str
    sim: dict
    generator: str
    source: dict | None = None

    @classmethod
    def of(cls, scale: str, sim: Mapping) -> "DatasetSpec":
        """Describes what the code at hand would generate."""
        kept = [key for key in sim if key not in NOT_SHAPING and OFF.get(key) != sim[key]]
        shaping = {key: replaced(sim[key], _whole) for key in kept}
        if "weather" in shaping:
            # The values of a weather that no clip has shape nothing.
            values = shaping["weather"].items()
            shaping["weather"] = {name: each for name, each in values if name in sim["weathers"]}
        towns = (str(town) for town in sim["towns"])
        modules = [town if "." in town else f"{TOWNS}.{town}" for town in towns]
        return cls(scale, shaping, digest_of(code_of([GENERATOR, *modules])))

    @property
    def digest(self) -> str:
        return digest_of([self.sim, self.generator, *filter(None, [self.source])])

    def root(self, data_folder: Path) -> Path:
        """Returns ``<data folder>/<scale>-<hash of everything that shapes the data>``."""
        return data_folder / f"{self.scale}-{self.digest}"


def missing_clips(root: Path, clip_ids: Sequence[str]) -> list[str]:
    """Returns the clips that are not on disk yet. A clip folder that exists is complete."""
    return [clip for clip in clip_ids if not (root / clip).is_dir()]


def write_manifest(root: Path, spec: DatasetSpec, clip_ids: Sequence[str], split: Split) -> Path:
    """Writes ``manifest.json`` under a temporary name and renames it. Its ``digest`` is its own."""
    # Those that shape a dataset, and are there.
    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)

    manifest = {
        "scale": spec.scale,
        "sim": spec.sim,
        "generator": spec.generator,
        **({"source": spec.source} if spec.source else {}),
        "packages": versions,
        "split": {part: len(frames) for part, frames in split.items()},
        "held_out": held_out_clips(split),
        "clips": {
            clip: {"sha256": sha256_of(root / clip / SUMS), "files": recorded_sums(root / clip)}
            for clip in clip_ids
        },
    }
    with replacing(root / MANIFEST) as temporary:
        temporary.write_text(json.dumps(sealed(manifest), indent=1, sort_keys=True) + "\n")
    return root / MANIFEST


def sealed(manifest: Mapping) -> dict:
    """Returns a manifest with its own digest, by which is noticed what was edited by hand."""
    return {**manifest, "digest": digest_of({**manifest, "digest": None})}


def read_manifest(root: Path) -> dict:
    """Reads the manifest of a dataset. Raises `UserError` where that fails."""
    path = root / MANIFEST
    try:
        manifest = json.loads(path.read_text())
        if missing := MANIFEST_KEYS - set(manifest):
            raise ValueError(f"no {', '.join(sorted(missing))} in it")
        if manifest != sealed(manifest):
            raise ValueError("its bytes are not the ones written")
        return manifest
    except FileNotFoundError:
        raise UserError(
            f"{path}: not found, so {root} is no finished dataset; run task=generate"
        ) from None
    except (OSError, ValueError, TypeError) as error:
        way_out = way_out_of(error, "run task=generate with the same settings to write it again")
        raise UserError(f"{path}: cannot be read ({error}); {way_out}") from error


def require_same_data(root: Path, spec: DatasetSpec) -> None:
    """Refuses a dataset that was made under other settings than the ones asked for."""
    manifest = read_manifest(root)
    made, wanted = dict(manifest["sim"]), dict(spec.sim)
    if "source" in manifest:
        # No simulator made it, so only what its clips are like counts.
        wanted = {key: each for key, each in wanted.items() if key in SHAPE}
        made = {key: made[key] for key in SHAPE}
    if "weather" not in made or "weather" not in wanted:
        # An older dataset or checkpoint names its weathers, whose values were code.
        made.pop("weather", None)
        wanted.pop("weather", None)

    for key, old, new in differences(made, wanted):
        raise UserError(
            f"{root}: was made with sim.{key}={short(old)}, and this run asks for {short(new)}; "
            f"set sim.{key} to match, or drop paths.dataset to generate the data asked for"
        )


def _whole(value: object) -> object:
    """Returns a whole number always as an integer: 5.0 Hz are 5 Hz."""
    return int(value) if isinstance(value, float) and value.is_integer() else value
