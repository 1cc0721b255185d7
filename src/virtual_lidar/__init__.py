"""Virtual LiDARs: they scan meshes, with modelled measurement errors, in generated scenes.

`scan` returns the points at which a virtual spinning LiDAR hits a mesh, as a table. An
`ErrorModel`, which `open_error_model` creates by name, adds measurement errors. `calibrate`
estimates the size of such errors from recordings of walls by a real sensor. `make_room`,
`make_street` and `make_object` generate meshes to scan. Lengths are in metres, and z is up. Invalid
input raises `pointkit.errors.InputError`. The names here are imported on first use.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from virtual_lidar.calibration.calibrating import Calibration as Calibration
    from virtual_lidar.calibration.calibrating import CalibrationOptions as CalibrationOptions
    from virtual_lidar.calibration.calibrating import calibrate as calibrate
    from virtual_lidar.calibration.files import write_calibration as write_calibration
    from virtual_lidar.calibration.fitting import Estimate as Estimate
    from virtual_lidar.errors import error_model_names as error_model_names
    from virtual_lidar.errors import open_error_model as open_error_model
    from virtual_lidar.errors.model import ERROR_MODELS as ERROR_MODELS
    from virtual_lidar.errors.model import Draws as Draws
    from virtual_lidar.errors.model import ErrorModel as ErrorModel
    from virtual_lidar.errors.model import Hits as Hits
    from virtual_lidar.placement import free_origin as free_origin
    from virtual_lidar.scan_returns import ScanReturns as ScanReturns
    from virtual_lidar.scan_returns import returns_of_scan as returns_of_scan
    from virtual_lidar.scan_returns import true_points as true_points
    from virtual_lidar.scan_table import COLUMNS as COLUMNS
    from virtual_lidar.scan_table import ScanTable as ScanTable
    from virtual_lidar.scan_table import read_scan as read_scan
    from virtual_lidar.scan_table import write_scan as write_scan
    from virtual_lidar.scan_table import write_scan_portions as write_scan_portions
    from virtual_lidar.scanning import ScanJob as ScanJob
    from virtual_lidar.scanning import scan as scan
    from virtual_lidar.scenes.calibration import calibration_scene as calibration_scene
    from virtual_lidar.scenes.objects import OBJECTS as OBJECTS
    from virtual_lidar.scenes.objects import make_object as make_object
    from virtual_lidar.scenes.rooms import ROOMS as ROOMS
    from virtual_lidar.scenes.rooms import make_room as make_room
    from virtual_lidar.scenes.rooms import room_origin as room_origin
    from virtual_lidar.scenes.street import make_street as make_street
    from virtual_lidar.scenes.street import street_origin as street_origin
    from virtual_lidar.sweep import SWEEPS as SWEEPS
    from virtual_lidar.sweep import Rays as Rays
    from virtual_lidar.sweep import Sweep as Sweep
    from virtual_lidar.sweep import open_sweep as open_sweep
    from virtual_lidar.walls.residuals import RecordedPlanes as RecordedPlanes
    from virtual_lidar.walls.residuals import RecordingOptions as RecordingOptions
    from virtual_lidar.walls.residuals import recorded_planes as recorded_planes
    from virtual_lidar.walls.residuals import recording_residuals as recording_residuals
    from virtual_lidar.walls.statistics import recording_summary as recording_summary

__getattr__, __dir__, __all__ = lazy(
    __name__,
    errors=("error_model_names", "open_error_model"),
    placement=("free_origin",),
    scan_returns=("ScanReturns", "returns_of_scan", "true_points"),
    scan_table=("COLUMNS", "ScanTable", "read_scan", "write_scan", "write_scan_portions"),
    scanning=("ScanJob", "scan"),
    sweep=("SWEEPS", "Rays", "Sweep", "open_sweep"),
    **{
        "calibration.calibrating": ("Calibration", "CalibrationOptions", "calibrate"),
        "calibration.files": ("write_calibration",),
        "calibration.fitting": ("Estimate",),
        "errors.model": ("ERROR_MODELS", "Draws", "ErrorModel", "Hits"),
        "scenes.calibration": ("calibration_scene",),
        "scenes.objects": ("OBJECTS", "make_object"),
        "scenes.rooms": ("ROOMS", "make_room", "room_origin"),
        "scenes.street": ("make_street", "street_origin"),
        "walls.residuals": (
            *("RecordedPlanes", "RecordingOptions", "recorded_planes", "recording_residuals"),
        ),
        "walls.statistics": ("recording_summary",),
    },
)
