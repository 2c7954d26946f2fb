"""The command line that makes a dataset again, from what its manifest says."""

import json
from collections.abc import Mapping
from itertools import chain


def overrides_of(manifest: Mapping) -> list[str]:
    """The overrides that name this very dataset, whatever the defaults are."""
    sim, held_out = manifest["sim"], manifest["held_out"]
    overrides = ["task=generate", f"scale={manifest['scale']}"]
    for key, value in sim.items():
        # The values of the weathers are files of the configuration, too many for a command line.
        if key != "weather":
            overrides += _assignments(f"sim.{key}", value)
    overrides += [f"data.{part}_clips={_plain(held_out[part])}" for part in ("val", "test")]

    # It shapes no data; but a step that the capture rate does not divide is refused.
    if (0.2 * sim["capture_hz"]) % 1:
        overrides.append(f"data.history_step_s={1 / sim['capture_hz']:g}")
    return overrides


def _assignments(key: str, value: object) -> list[str]:
    """``key=value``, one for each leaf. The grid is set once for data and model."""
    if isinstance(value, Mapping):
        leaves = (_assignments(f"{key}.{name}", leaf) for name, leaf in value.items())
        return list(chain.from_iterable(leaves))
    key = key.replace("sim.grid.", "grid.")
    # These two groups are empty by default, and take what their classes take.
    add = "++" if key.startswith(("sim.flight.", "sim.traffic.")) else ""
    return [f"{add}{key}={_plain(value)}"]


def _plain(value: object) -> str:
    """A value as Hydra's command line reads it."""
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_plain, value))}]"
    return json.dumps(value) if value is None or isinstance(value, bool) else str(value)
