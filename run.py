"""Composes the configuration and calls the task: ``python run.py +experiment=skyocc``."""

import gc
import os
import sys

if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    print(
        "error: this is Python {}.{}, and SkyShield needs 3.10 to 3.13; make setup finds one of "
        "them".format(*sys.version_info),
        file=sys.stderr,
    )
    sys.exit(2)


def _interrupted(kind: type, error: BaseException, trace: object) -> None:
    """Tells of Ctrl-C in a line while modules are still imported, which takes seconds."""
    if kind is KeyboardInterrupt:
        print("error: interrupted; nothing was begun", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _interrupted
if {"-h", "--help"} & {*sys.argv[1:]}:  # Hydra's own is every key, after seconds of imports
    from src.help import print_help

    print_help()
    sys.exit(0)
gc.disable()  # until the task begins: nothing that is imported or composed is garbage

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from src.failures import quiet_libraries, told_in_one_line
from src.settings import do_task, require_sound

# A launcher's processes import src as well, from whatever folder they begin in.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, (os.path.dirname(os.path.abspath(__file__)), os.environ.get("PYTHONPATH")))
)
# Hydra would print its own errors over many lines and swallow the rest.
os.environ.setdefault("HYDRA_FULL_ERROR", "1")


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def run(cfg: DictConfig) -> None:
    """Calls the configured task with the composed configuration."""
    # In here as well as below, or Hydra adds lines of its own.
    with told_in_one_line():
        of_hydra = HydraConfig.get()
        require_sound(cfg, of_hydra)
        do_task(cfg, of_hydra)


if __name__ == "__main__":
    quiet_libraries()
    with told_in_one_line():
        run()
