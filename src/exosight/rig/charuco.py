"""Calibration of a camera from pictures of a ChArUco board.

A chessboard whose white squares hold ArUco markers, so that each corner between squares is known by number
(Garrido-Jurado et al., Automatic generation and detection of highly reliable fiducial markers under
occlusion, Pattern Recognition 47, 2014). OpenCV finds the corners and fits the camera to them (Zhang, A
flexible new technique for camera calibration, 2000): what `exosight.system.camera.Camera` has, one focal
length f, the principal point and k₁ of Brown's lens. The board's frame has its origin at the upper left
corner of the board, x along the upper edge, y down, z into it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from exosight.errors import DataError, InputError
from exosight.rig.folder import PictureFolder

DICTIONARIES = {
    name.removeprefix("DICT_"): getattr(cv2.aruco, name)
    for name in dir(cv2.aruco)
    if name.startswith(("DICT_4X4", "DICT_5X5", "DICT_6X6", "DICT_7X7"))
}
FEWEST_CORNERS = 8
"""That a picture needs to count as one of the board."""
FEWEST_VIEWS = 5
"""Two tell the four numbers of the lens; more tell whether they fit."""
LEAST_TILT = 10.0
"""Between the two pictures whose boards are turned furthest apart [deg]: parallel boards of unknown distance
look alike at every focal length."""
LARGEST_ERROR = 0.004
"""Root mean square of the distances of corners from where they are expected, as a share of the picture's
width: 2.5 pixels of 640. Corners are found to a tenth of a pixel; what is not fitted of a wide lens may
leave one pixel."""
Side = Annotated[float, Field(gt=0, le=10)]


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class Board:
    """A printed ChArUco board.

    Raises a validation error for markers that are not smaller than squares.
    """

    squares: tuple[Annotated[int, Field(ge=3, le=100)], Annotated[int, Field(ge=3, le=100)]]
    """columns and rows of squares"""
    square: Side
    """side of a square, as measured on the print [m]"""
    marker: Side
    """side of a marker [m]"""
    dictionary: str = "4X4_50"
    """ArUco dictionary of its markers, such as 4X4_50, 5X5_100 or 6X6_250"""

    def __post_init__(self) -> None:
        if self.marker >= self.square:
            raise ValueError(
                f"marker: expected a side below that of squares, {self.square:g} m, got {self.marker:g} m"
            )
        if self.dictionary not in DICTIONARIES:
            raise ValueError(
                f"dictionary: expected one of {', '.join(DICTIONARIES)}, got {self.dictionary[:40]!r}"
            )

    @property
    def name(self) -> str:
        """As messages call it."""
        return "×".join(map(str, self.squares)) + f" squares with markers {self.dictionary}"

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's; InputError if its dictionary has too few markers."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary])
        needed, known = self.squares[0] * self.squares[1] // 2, len(dictionary.bytesList)
        if needed > known:
            raise InputError(
                f"board: expected a dictionary of {needed} markers or more for {self.name}, got {known}; "
                "choose the one that it was printed with"
            )
        return cv2.aruco.CharucoBoard(self.squares, self.square, self.marker, dictionary)


@dataclass(frozen=True)
class View:
    """The corners of the board that a picture shows.

    name      of the picture
    ids       (corners,)     their numbers on the board, row after row
    corners   (corners, 2)   column and row [pixels], pixel centres at integer + 0.5
    """

    name: str
    ids: Int[np.ndarray, " corners"]
    corners: Float[np.ndarray, "corners 2"]


@dataclass(frozen=True)
class Calibration:
    """A camera's lens, and where it was in each view.

    size           width and height of the pictures [pixels]
    focal_length   and its standard deviation [pixels]
    principal      (2,)          column and row of the principal point [pixels], and its deviations
    radial         k₁ of x (1 + k₁|x|²), x = (right, down)/depth, and its deviation
    rotations      (views, 3, 3)   board to camera: right, down, along the view
    translations   (views, 3)      the board's origin in the camera's frame [m]
    errors         (views,)        root mean square of the corners' errors in each view [pixels]
    error          of all corners [pixels]
    """

    size: tuple[int, int]
    focal_length: tuple[float, float]
    principal: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]
    radial: tuple[float, float]
    rotations: Float[np.ndarray, "views 3 3"]
    translations: Float[np.ndarray, "views 3"]
    errors: Float[np.ndarray, " views"]
    error: float

    @property
    def tilts(self) -> Float[np.ndarray, " views"]:
        """Angle of each board from the picture's plane [rad]."""
        return np.arccos(np.clip(self.rotations[:, 2, 2], -1, 1))


def find_board(picture: UInt8[np.ndarray, "rows columns"], board: Board, name: str) -> View | None:
    """The corners that a gray picture shows; None: too few of them.

    Raises DataError, beginning with `name`, for markers that the board has not.
    """
    charuco = board.charuco()
    corners, ids, _, markers = cv2.aruco.CharucoDetector(charuco).detectBoard(picture)
    highest = -1 if markers is None else int(np.max(markers, initial=-1))
    if highest >= len(charuco.getIds()):
        raise DataError(
            f"{name}: expected markers 0 to {len(charuco.getIds()) - 1} of a board of {board.name}, got "
            f"{highest}; give the board's own size and dictionary"
        )
    if ids is None or len(ids) < FEWEST_CORNERS:
        return None
    return View(name, ids.ravel().astype(int), corners.reshape(-1, 2).astype(float) + 0.5)


def find_boards(
    pictures: PictureFolder, board: Board, done: Callable[[int, int], None] = lambda k, n: None
) -> tuple[tuple[View, ...], tuple[int, int]]:
    """The views of all pictures that show the board, and width and height of the pictures [pixels].

    done   called with how many of how many pictures are read

    Raises DataError for pictures of several sizes, or with markers that the board has not.
    """
    views, size = [], (0, 0)
    for place, file in enumerate(pictures.names):
        picture = pictures.picture(place)
        own = picture.shape[1], picture.shape[0]
        if place and own != size:
            raise DataError(
                f"{pictures.root / file}: expected {size[0]}×{size[1]} pixels, as {pictures.names[0]} has, "
                f"got {own[0]}×{own[1]}; take pictures of one camera, all upright or all not"
            )
        size = own
        view = find_board(picture, board, file)
        views += [] if view is None else [view]
        done(place + 1, len(pictures.names))
    return tuple(views), size


def calibrate(views: Sequence[View], board: Board, size: tuple[int, int]) -> Calibration:
    """The camera that shows the board as the views do, by least squares of the corners' errors.

    size   width and height of the pictures [pixels]

    Raises DataError for too few views, all parallel, or corners that no camera shows so.
    """
    if len(views) < FEWEST_VIEWS:
        raise DataError(
            f"pictures: expected {FEWEST_VIEWS} or more that show a board of {board.name}, got {len(views)}; "
            "take more, or give the board's own size and dictionary"
        )
    places = np.asarray(board.charuco().getChessboardCorners(), np.float32)
    # One focal length, no decentring, k₁ alone: what a system file's camera has.
    flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    try:
        error, matrix, lens, turns, shifts, deviations, _, errors = cv2.calibrateCameraExtended(
            [places[view.ids] for view in views],
            [view.corners.astype(np.float32) for view in views],
            size,
            np.eye(3),
            np.zeros(5),
            flags=flags,
        )
    except cv2.error as failure:
        raise DataError(
            f"pictures: no camera shows a board of {board.name} so; give the board's own size, and pictures "
            "of it from several sides"
        ) from failure
    if not error <= LARGEST_ERROR * size[0]:
        raise DataError(
            f"pictures: expected corners of a board of {board.name}, got some {error:.1f} pixels away from "
            "where any camera shows them; give the board's own size, print it flat, and leave out blurred "
            "pictures"
        )
    rotations = np.array([cv2.Rodrigues(turn)[0] for turn in turns])
    normals = rotations[:, :, 2]
    apart = np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1)))
    if apart < LEAST_TILT:
        raise DataError(
            f"pictures: expected the board tilted by {LEAST_TILT:g} degrees or more between two of them, got "
            f"{apart:.0f}; parallel boards do not tell the focal length"
        )
    _, fy, cx, cy, k1 = deviations.ravel()[:5]  # fx is fy times a fixed ratio, and has none of its own
    return Calibration(
        size=size,
        focal_length=(float(matrix[0, 0]), float(fy)),
        principal=(matrix[:2, 2], np.array([cx, cy])),
        radial=(float(lens.ravel()[0]), float(k1)),
        rotations=rotations,
        translations=np.reshape(shifts, (-1, 3)),
        errors=errors.ravel(),
        error=float(error),
    )
