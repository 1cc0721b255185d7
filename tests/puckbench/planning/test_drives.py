"""Plans of drives, and the entries that are refused."""

from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.planning.drives import consecutive
from puckbench.planning.workflow import Workflow

DRIVE = {
    "scene_set": "street",
    "sweep": {"preset": "spin", "trajectory": [[0, 0, 0, 0, 0, 0, 0], [1, 5, 0, 0, 0, 0, 0]]},
    "rates": ["200mm", "2cm"],
}


def workflow(**drive: Any) -> Workflow:
    config: dict[str, Any] = {
        "scene_sets": {
            "street": {"loader": "street", "options": {"streets": 1}},
            "streets": {"loader": "street", "options": {"streets": 3}},
        },
        "datasets": {},
        "drives": {"way": {**DRIVE, **drive}},
        "codecs": {"draco": {}, "puck": {}, "gpcc_predictive": {}, "packets_xz": {}},
    }
    return Workflow(config)


def test_each_scene_and_seed_is_a_drive_and_each_codec_codes_it() -> None:
    flow = workflow(seeds=[4, 7])
    drives = flow.drives
    entry = drives.entries["way"]
    assert entry.drives == ("street_1-4", "street_1-7")
    assert entry.rates["draco"] == entry.rates["puck"] == ("200mm", "20mm")
    assert entry.rates["gpcc_predictive"] == ("128mm", "32mm", "16mm", "4mm", "2mm", "1mm")
    assert "packets_xz" not in entry.rates
    assert len(drives.rows) == 2 + len(drives.curves) == 2 * 4
    names = {"drives": "way", "drive": "street_1-7"}
    assert flow.step("drive", **names).step.seed == 7
    steps = (flow.step("encode_drive", **names, codec=codec) for codec in ("puck", "draco"))
    assert len({step.settings for step in steps}) == 2


def test_each_scene_has_its_trajectory() -> None:
    motions = {
        "street_1": {"duration_s": 3, "speed_m_s": 5},
        "street_3": {"duration_s": 4, "speed_m_s": 8, "start": [-20, 0]},
    }
    flow = workflow(trajectories=motions, scene_set="streets")
    assert flow.drives.entries["way"].drives == ("street_1-1", "street_3-1")
    both = [{"drives": "way", "drive": f"street_{number}-1"} for number in (1, 3)]
    first, third = (flow.step("drive", **names) for names in both)
    assert '"speed_m_s":5' in first.settings
    assert '"start":[-20' in third.settings
    assert first.fingerprint != third.fingerprint
    first, third = (flow.step("encode_drive", **names, codec="puck") for names in both)
    assert first.settings == third.settings


@pytest.mark.parametrize("task", ["odometry", "gicp_odometry"])
def test_reference_of_a_recorded_drive_has_the_options_of_the_task(
    tmp_path: Path, task: str
) -> None:
    for number in range(2):
        (tmp_path / f"turn_{number}.xyz").write_text("0 0 1\n1 0 1\n")
    clouds = {"loader": "point_clouds", "options": {"path": str(tmp_path)}}
    config = {
        "scene_sets": {"clouds": clouds},
        "datasets": {},
        "drives": {
            "real": {
                "scene_set": "clouds",
                "make": "cloud",
                "tasks": {task: {"max_range_m": 20, "voxel_m": 0.2}},
            }
        },
        "codecs": {"draco": {}},
    }
    step = Workflow(config).step("drive_of_clouds", drives="real", drive="turn").step
    assert step.odometry == {"max_range_m": 20, "voxel_m": 0.2}


def test_tables_of_odometry_get_the_configured_margins() -> None:
    config = workflow().plan.config.model_dump(by_alias=True, exclude_unset=True)
    assert workflow().outputs.table_options("odometry_bits") == {}
    chosen = Workflow({**config, "odometry_margins": {"deviation_mm": 20}})
    for table in ("odometry_bits", "odometry_differences"):
        assert chosen.outputs.table_options(table) == {"margins": {"deviation_mm": 20.0}}


def test_table_and_figure_of_odometry_are_made_if_it_is_a_task() -> None:
    outputs = workflow().outputs
    assert "odometry" in outputs.figures
    assert "odometry_bits" in outputs.tables
    other = workflow(tasks={"registration": {}}).outputs
    assert "odometry" not in other.figures


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene_set": "road"}, "drives.way.scene_set: no scene set 'road'"),
        ({"sweep": "spin"}, "drives.way: sweep: needs a trajectory"),
        ({"sweep": {**DRIVE["sweep"], "duration_s": 0.2}}, "1 frames, 5 turns a second: a drive"),
        ({"make": "cloud"}, "make is 'cloud', but street has meshes: scan"),
        ({"codecs": ["dracos"]}, "no codec 'dracos'.*did you mean 'draco'"),
        ({"tasks": {"odometri": {}}}, "unknown task 'odometri'.*did you mean 'odometry'"),
        ({"tasks": {"odometry": {"voxel": 1}}}, "task odometry: options: .*'voxel'"),
        (
            {"trajectories": {"street_2": {"duration_s": 3, "speed_m_s": 5}}},
            "drives.way: trajectories: no scene 'street_2' in street",
        ),
        ({"errors": "vlp61"}, "drives.way: unknown error model 'vlp61'"),
    ],
)
def test_faulty_entries_are_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        workflow(**changes)
    assert "\n" not in str(raised.value)


def test_clouds_of_a_drive_follow_one_another() -> None:
    assert consecutive(("b_0002", "a_1", "b_0004", "a_2")) == {
        "b": ("b_0002", "b_0004"),
        "a": ("a_1", "a_2"),
    }
    with pytest.raises(InputError, match="drive a: a gap between a_2 and a_4"):
        consecutive(("a_1", "a_2", "a_4"))
    with pytest.raises(InputError, match="drive a: a single turn"):
        consecutive(("a_1",))
    with pytest.raises(InputError, match="cloud office: its name does not end in _NUMBER"):
        consecutive(("office",))
