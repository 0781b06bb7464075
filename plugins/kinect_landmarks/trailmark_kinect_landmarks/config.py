"""Configs of the localizers that look at RGB-D pictures."""

from __future__ import annotations

from typing import ClassVar, Literal, get_args

from pydantic import Field, model_validator

from trailmark.config import OutputPath, PluginConfig, PresetConfig, PresetValue, Sensor

__all__ = ["FEW", "FINDER_NAMES", "CropConfig", "KinectFlowConfig", "KinectLandmarksConfig", "RgbdConfig"]

FinderName = Literal["blobs", "rectangles", "edges", "ellipses", "lines", "flats", "mser", "hough_circles"]
#: All that `finders` may name.
FINDER_NAMES: tuple[FinderName, ...] = get_args(FinderName)

#: With fewer landmarks that are wanted, it matters which.
FEW = 12
#: Landmarks that are followed beside the few, so that one that is lost is replaced by one that is known.
_CANDIDATES = 20


class CropConfig(PluginConfig):
    """Lines of the colour picture that the depth camera does not see."""

    left: int = Field(0, ge=0)
    """Columns at the left [px]."""
    right: int = Field(0, ge=0)
    """Columns at the right [px]."""
    top: int = Field(0, ge=0)
    """Lines at the top [px]."""
    bottom: int = Field(0, ge=0)
    """Lines at the bottom [px]."""


#: How both modes of the paper see: in the plane, with its angles and its depth.
_SIGHT = {
    "solve": PresetValue("plane", "Figs. 2 and 3: seen from above"),
    "angles": PresetValue("linear", "angles by counting pixels from the middle"),
    "depth_kind": PresetValue("range", "Eqs. 7 to 10: depth along the ray"),
    "field_of_view_deg": PresetValue(57.0, "of its Kinect"),
    "min_landmarks": PresetValue(2, "two landmarks are enough"),
}


class RgbdConfig(PresetConfig):
    """What the localizers share: the camera, its depth, and when landmarks carry a pose."""

    presets: ClassVar = {"paper": _SIGHT}

    preset: Literal["paper"] | None = None
    """The method as printed; what is written beside it wins. Its calibration, `crop`, is the camera's own."""
    camera: Sensor["rgbd"]
    """Colour camera with depth."""
    scan: Sensor["scan", "scalar"] | None = None
    """Laser or ultrasound that fills in where a landmark has no depth (glass, gloss). A scalar is a range along the x
    axis of its mounting [m]."""

    solve: Literal["space", "plane"] = "space"
    """space: in three dimensions, then projected to the plane of the start; for hand-held cameras and tilting robots.
    plane: as the paper, for robots that stay level; needs two landmarks instead of three."""
    angles: Literal["pinhole", "linear"] = "pinhole"
    """linear: "counting pixels" as the paper, up to 0.94 deg off."""
    depth_kind: Literal["z", "range"] | None = None
    """What depth measures: z from the camera's plane, range along the ray (as the paper's equations are printed).
    Default: as the calibration says, and z where it does not."""
    crop: CropConfig | None = None
    """The paper's calibration, Eqs. (3)-(6): lines of colour that depth does not see. Replaces the calibration's."""
    field_of_view_deg: float = Field(57.0, gt=0.0, lt=170.0)
    """Horizontal capture angle of the colour camera, for sensors without a calibration (Kinect: 57) [deg]."""

    near_m: float = Field(0.4, gt=0.0)
    """Depth nearer than this is not believed [m]."""
    far_m: float = Field(6.0, gt=0.0)
    """Depth farther than this is not believed [m]."""

    min_landmarks: int = Field(3, ge=2)
    """Landmarks that must agree before there is an answer; in the plane 2 are enough for the paper, which keeps a
    third in reserve."""
    min_separation_m: float = Field(0.3, gt=0.0)
    """Landmarks nearer to one another than this are degenerate [m]."""
    min_angle_deg: float = Field(2.0, gt=0.0, lt=90.0)
    """Landmarks in line with the camera, to within this, are degenerate [deg]."""

    @model_validator(mode="after")
    def _near_before_far(self) -> RgbdConfig:
        if self.near_m >= self.far_m:
            raise ValueError(f"near_m ({self.near_m:g}) must be less than far_m ({self.far_m:g})")
        return self


class KinectLandmarksConfig(RgbdConfig):
    """Landmarks found, remembered, found again and triangulated (Toth et al. 2015)."""

    presets: ClassVar = {
        "paper": {
            **_SIGHT,
            "finders": PresetValue(
                ("blobs", "edges", "ellipses", "lines", "rectangles", "flats"), "what it finds, in its order"
            ),
            "point": PresetValue("centre", "the centre of the frame around a blob"),
            "refind": PresetValue("look", "it looks for all remembered landmarks in a new picture"),
            "adapt": PresetValue(True, "fuzzy choice, smaller pictures when slow"),
            "landmarks": PresetValue(3, "two landmarks and one in reserve"),
            "trial": PresetValue(1, "not in the paper"),
            "min_agreeing": PresetValue(2, "two landmarks are enough"),
            "place_alike": PresetValue(0.0, "not in the paper"),
            "notice_tilt": PresetValue(False, "not in the paper: its robots stay level"),
            "moved_after": PresetValue(1_000_000, "not in the paper: moving landmarks are an error"),
        }
    }

    light: Sensor["scalar"] | None = None
    """Ambient light; without it the picture's own brightness is used."""
    finders: tuple[FinderName, ...] = Field(
        ("blobs", "rectangles", "edges", "ellipses", "lines", "flats", "mser"), min_length=1
    )
    """Landmark finders, the most useful first: when time is short the last are left out first."""
    point: Literal["corner", "centre"] = "corner"
    """Pixel that stands for a landmark: the best marked one in its frame, or the frame's centre as in the paper."""
    refind: Literal["flow", "look"] = "flow"
    """flow: follow landmarks from picture to picture by optical flow, and look for the others. look: look for all,
    by colours and vicinity."""
    adapt: bool = True
    """Whether fuzzy rules choose finders and resolution; otherwise all run on the whole picture."""
    allowed_ms: float | None = Field(None, gt=0.0)
    """Time allowed for a picture; default: the time between two [ms]."""

    landmarks: int = Field(60, ge=3)
    """Landmarks wanted in each picture, reserve included."""
    alike: float = Field(0.75, gt=0.0, le=1.0)
    """How alike a landmark must look to be taken for a remembered one, 0 to 1."""
    min_agreeing: int = Field(12, ge=2)
    """So many landmarks must agree on a pose that is not followed from picture to picture, and
    near none that was told, was begun at anew, or that motions lead to: some look alike anywhere."""
    place_alike: float = Field(0.62, ge=0.0, le=1.0)
    """So alike must the taught landmarks look, in the mean, that should be seen from that pose: where other posters
    hang, this is another room of the same plan. 0: not asked."""
    search_px: float = Field(40.0, gt=0.0)
    """How far from where it should be a landmark is looked for [px]."""
    trial: int = Field(3, ge=1)
    """Sightings in agreement before a new landmark votes on the pose."""
    moved_after: int = Field(5, ge=1)
    """Sightings in a row against all others after which a landmark counts as moved and is set aside."""

    notice_tilt: bool = True
    """Whether `solve: plane` gives way to space once the heights of landmarks say that the camera tilts."""

    remembered: int = Field(2000, ge=100)
    """Landmarks remembered at the same time, those of a taught place not counted; what is worth least is forgotten."""

    restart_s: float = Field(1.0, gt=0.0)
    """Lost for so long, it remembers anew where it is believed to be, and says with what uncertainty; what is found
    again then is doubted, unless motions lead there. Motions that are older tell nothing [s]."""

    debug_images: OutputPath | None = None
    """Folder for the paper's six stage pictures (Figures 5-10) of every picture; slow."""

    @property
    def n_followed(self) -> int:
        """Number of landmarks that are followed from picture to picture."""
        return self.landmarks if self.landmarks >= FEW else self.landmarks + _CANDIDATES

    @model_validator(mode="after")
    def _follows_as_many_as_must_agree(self) -> KinectLandmarksConfig:
        if self.min_agreeing > self.n_followed:
            raise ValueError(
                f"min_agreeing ({self.min_agreeing}) must be at most {self.n_followed}, the number of landmarks that "
                f"are followed with landmarks ({self.landmarks})"
            )
        return self


class KinectFlowConfig(RgbdConfig):
    """Optical-flow localization: the paper's second mode, Eqs. (1)-(2)."""

    points: int = Field(150, ge=10)
    """Points followed from picture to picture."""
    apart_px: int = Field(10, ge=2)
    """Least distance of two points [px]."""
