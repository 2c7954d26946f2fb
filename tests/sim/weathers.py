"""The weathers of the configuration by name: their values, and `Weather` objects made of them."""

from pathlib import Path

import yaml

from src.sim.weather import Weather

FILES = sorted((Path(__file__).parents[2] / "conf/sim/weather").glob("*.yaml"))
VALUES = {path.stem: yaml.safe_load(path.read_text()) for path in FILES}
WEATHERS = {name: Weather.of({"weather": VALUES}, name) for name in VALUES}
