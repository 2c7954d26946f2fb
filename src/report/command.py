"""The command line that makes a dataset again, from what its manifest says."""

from collections.abc import Mapping


def overrides_of(manifest: Mapping) -> list[str]:
    """The words of the command line that name this very dataset, whatever the defaults are."""
    sim, held_out = manifest["sim"], manifest["held_out"]
    words = ["task=generate", f"scale={manifest['scale']}"]
    words += [word for key, value in sim.items() for word in _assignments(f"sim.{key}", value)]
    words += [f"data.{part}_clips={_plain(held_out[part])}" for part in ("val", "test")]
    # Not of the data: but a step that the capture rate does not divide is refused.
    if (0.2 * sim["capture_hz"]) % 1:
        words.append(f"data.history_step_s={1 / sim['capture_hz']:g}")
    return words


def _assignments(key: str, value: object) -> list[str]:
    """``key=value``, one for each leaf. The grid is set once for data and model."""
    if isinstance(value, Mapping):
        return [w for name, leaf in value.items() for w in _assignments(f"{key}.{name}", leaf)]
    key = key.replace("sim.grid.", "grid.")
    # These two groups are empty by default, and take what their classes take.
    add = "++" if key.startswith(("sim.flight.", "sim.traffic.")) else ""
    return [f"{add}{key}={_plain(value)}"]


def _plain(value: object) -> str:
    """A value as Hydra's command line reads it."""
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_plain, value))}]"
    words = {None: "null", True: "true", False: "false"}
    return words[value] if value is None or isinstance(value, bool) else str(value)
