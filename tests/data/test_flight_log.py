"""A CSV of poses: which columns will do, what is between its lines, and what is refused."""

import math

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.flight_log import FlightLog
from src.errors import UserError
from src.geometry import rigid, rotation_from_euler
from tests.synthetic import flight

TRUE = flight(10.0).assign(height_m=lambda table: table.z_m)
WHEN = np.linspace(0.03, 11.8, 200)
PLACE, SPEED = ["x_m", "y_m"], ["vx_mps", "vy_mps", "vz_mps"]
RAD = ["roll_rad", "pitch_rad", "yaw_rad"]
QUAT = ["qx", "qy", "qz", "qw"]


@pytest.fixture
def read(tmp_path):
    """Writes a table as a CSV and reads it."""

    def written(table, convention="enu"):
        table.to_csv(tmp_path / "poses.csv", index=False)
        return FlightLog.read(tmp_path / "poses.csv", convention)

    return written


def true_poses(times_s):
    """The poses of `flight`, by its own formulas."""
    t = torch.from_numpy(times_s)
    roll, pitch = 0.2 * torch.sin(1.3 * t), 0.1 * torch.cos(0.9 * t)
    rotation = rotation_from_euler(roll, pitch, 0.25 * torch.sin(0.4 * t))
    return rigid(rotation, torch.stack([2 * t, torch.sin(0.3 * t), 6.3 + 0.1 * t], -1)).numpy()


@pytest.mark.parametrize("attitude", [QUAT, RAD])
def test_poses_are_interpolated_on_the_sphere(read, attitude):
    log = read(TRUE[["time_s", "height_m", *PLACE, *SPEED, *attitude]])
    assert np.abs(log.poses_at(WHEN) - true_poses(WHEN)).max() < 2e-3
    assert np.abs(log.velocities_at(WHEN)[:, 0] - 2).max() < 1e-9
    rotation = log.poses_at(WHEN)[:, :3, :3]
    assert np.abs(rotation @ rotation.swapaxes(-1, -2) - np.eye(3)).max() < 1e-12


def test_lines_are_counted_as_they_are_and_no_column_moves(tmp_path):
    path = tmp_path / "poses.csv"
    head = "time_s,height_m,roll_rad,pitch_rad,yaw_rad\n"
    path.write_text(head + "0,5,0,0,0,\n0.1,5,0,0,0,\n")
    assert FlightLog.read(path, "enu").height_m.tolist() == [5, 5]
    path.write_text(head + "0,5,0,0,0\n\n\nx,5,0,0,0\n")
    with pytest.raises(UserError, match=r"line 5: time_s is x"):
        FlightLog.read(path, "enu")
    path.write_text(head + "0,5,0,0,0\n0,5,0,0,0\n")
    with pytest.raises(UserError, match="has 1 poses; give two or more"):
        FlightLog.read(path, "enu")


def test_an_image_that_is_named_twice_is_refused(read):
    log = read(TRUE[["time_s", "height_m", *RAD]].head(3).assign(image=["a", "b", "a"]))
    with pytest.raises(UserError, match="image a is there twice"):
        log.named_images()


def test_half_a_turn_between_two_poses_goes_the_shorter_way_at_one_rate(read):
    yaw = [math.radians(170), math.radians(-170)]
    table = pd.DataFrame({"time_s": [0, 1], "height_m": 5, "roll_rad": 0, "pitch_rad": 0})
    log = read(table.assign(yaw_rad=yaw))
    found = np.unwrap(np.arctan2(*log.poses_at(np.linspace(0, 1, 5))[:, 1::-1, 0].T))
    assert np.rad2deg(found) == pytest.approx([170, 175, 180, 185, 190])


def test_other_names_and_degrees_say_the_same(read):
    degrees = TRUE.rename(columns={"time_s": "time", "height_m": "altitude_m"}).drop(
        columns=["altitude_m"]
    )
    degrees["altitude_m"] = TRUE.height_m
    for name in ("roll", "pitch", "yaw"):
        degrees[f" {name}_deg"] = np.rad2deg(TRUE[f"{name}_rad"])
    given = degrees[["time", "altitude_m", " roll_deg", " pitch_deg", " yaw_deg", *PLACE]]
    poses = read(given).poses_at(WHEN)
    assert (
        np.abs(poses - read(TRUE[["time_s", "height_m", *PLACE, *RAD]]).poses_at(WHEN)).max() < 1e-9
    )


def test_ned_is_turned_into_our_axes(read):
    """With F = diag(1, -1, -1) a rotation becomes F R F: pitch and yaw change their signs."""
    ned = TRUE[["time_s", "height_m", *PLACE, *SPEED, *RAD]].copy()
    ned[["y_m", "vy_mps", "vz_mps", "pitch_rad", "yaw_rad"]] *= -1
    log, ours = read(ned, "ned"), read(TRUE[["time_s", "height_m", *PLACE, *SPEED, *RAD]])
    assert np.abs(log.poses_at(WHEN) - ours.poses_at(WHEN)).max() < 1e-12
    assert np.abs(log.velocities_at(WHEN) - ours.velocities_at(WHEN)).max() < 1e-12


def test_a_motion_that_is_not_given_is_derived_and_said(read):
    both = read(TRUE[["time_s", "height_m", *PLACE, *SPEED, *RAD]])
    derived = read(TRUE[["time_s", "height_m", *PLACE, *RAD]])
    assert "derivative" in derived.motion
    assert np.abs(derived.velocities_at(WHEN) - both.velocities_at(WHEN)).max() < 0.01

    integrated = read(TRUE[["time_s", "height_m", *SPEED, *RAD]])
    assert "integral" in integrated.motion
    apart = integrated.poses_at(WHEN)[:, :3, 3] - both.poses_at(WHEN)[:, :3, 3]
    assert np.abs(apart - apart[0]).max() < 0.01

    unknown = read(TRUE[["time_s", "height_m", *RAD]])
    assert "neither" in unknown.motion
    assert unknown.velocities_at(WHEN) is None
    assert (unknown.poses_at(WHEN)[:, :2, 3] == 0).all()


GIVEN = TRUE[["time_s", "height_m", *PLACE, *RAD]]


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (TRUE[["time_s", *RAD]], r"lacks height_m \(or altitude_m\)"),
        (TRUE[["height_m", "pitch_rad"]], "lacks time_s .*roll_rad .or roll_deg, or qx.*; yaw_rad"),
        (GIVEN.drop(columns="y_m"), "lacks y_m; give all of x_m, y_m"),
        (GIVEN.assign(x_m=GIVEN.x_m.where(GIVEN.index != 4)), "line 6: x_m is nan; give a number"),
        (
            GIVEN.assign(x_m=GIVEN.x_m.astype(object).where(GIVEN.index != 4, "?")),
            r"line 6: x_m is \?",
        ),
        (GIVEN.iloc[[0, 1, 2, 1, 3]], "line 5: time_s goes back"),
        (GIVEN.iloc[[0, 1, 1, 2]].assign(x_m=[0, 1, 2, 3]), "line 4: another pose at a time_s"),
        (GIVEN.assign(yaw_rad=90.0), "yaw_rad reaches 90.0; name degrees yaw_deg"),
        (TRUE[["time_s", "height_m", *QUAT]].assign(qw=2.0), r"line 2: the length of qx.* is 2\.0"),
        (GIVEN.iloc[:1], "has 1 poses; give two"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(read, table, told):
    with pytest.raises(UserError, match=told) as refusal:
        read(table)
    assert "\n" not in str(refusal.value)
    assert "poses.csv" in str(refusal.value)


@pytest.mark.parametrize("content", ["", "\x00\x01", None])
def test_a_file_that_is_no_table_is_named(tmp_path, content):
    if content is not None:
        (tmp_path / "poses.csv").write_text(content)
    with pytest.raises(UserError, match=r"poses\.csv (cannot be read|lacks)"):
        FlightLog.read(tmp_path / "poses.csv")


def test_lines_twice_and_gaps_are_told(read, capsys):
    log = read(GIVEN.iloc[[0, 1, 1, 2, 12, 13]])
    told = capsys.readouterr().out
    assert "1 lines are there twice" in told
    assert "1 gaps of more than 0.5 s, of up to 1.00 s after 0.2 s" in told
    assert len(log.time_s) == 5


def test_times_outside_the_poses_are_refused_with_both_spans(read):
    log = read(GIVEN)
    log.require_span(np.array([0.0, 11.9]), "flight.mp4")
    for times_s in ([-0.1, 5.0], [0.0, 11.95]):
        with pytest.raises(UserError, match=r"flight\.mp4 has images from .* s, and .*11\.900 s;"):
            log.require_span(np.array(times_s), "flight.mp4")


def test_a_clock_in_milliseconds_is_asked_for_seconds(read):
    with pytest.raises(UserError, match=r"^poses: .* 100 s apart; is time_s in seconds"):
        read(TRUE.assign(time_s=TRUE.time_s * 1000))


def test_semicolons_are_told(tmp_path):
    TRUE.to_csv(tmp_path / "poses.csv", index=False, sep=";")
    with pytest.raises(UserError, match="separate columns by commas"):
        FlightLog.read(tmp_path / "poses.csv")
