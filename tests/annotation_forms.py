"""Drawn photographs in the forms of annotations: a small file or folder of each one's own shape."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import drawn_roads
from drawn_roads import EYE_M, HEIGHT, HORIZON, SLOPE, WIDTH, Drawn

FOCAL_PX = SLOPE / EYE_M


def kitti(folder: Path, drawn: Sequence[Drawn]) -> tuple[Path, Path]:
    """Write drawn photographs as KITTI has them: the place of a box is the middle of its foot."""
    drawn_roads.write_pictures(folder / "image_2", drawn)
    (folder / "label_2").mkdir()
    (folder / "calib").mkdir()
    for photo in drawn:
        lines = []
        for n, (ahead, left, _) in enumerate(photo.boxes):
            box, turned_by = " ".join(map(str, photo.corners(n))), math.pi / 2
            lines.append(f"Car 0.00 0 0.1 {box} 1.2 1.5 4.0 {-left:.2f} 1.5 {ahead + 2:.3f} {turned_by:.4f}")
        lines.append("DontCare -1 -1 -10 5 5 20 20 -1 -1 -1 -1000 -1000 -1000 -10")
        name = photo.file.replace(".png", ".txt")
        (folder / "label_2" / name).write_text("\n".join(lines) + "\n")
        matrix = f"{FOCAL_PX} 0 {WIDTH / 2} 0 0 {FOCAL_PX} {HORIZON} 0 0 0 1 0"
        (folder / "calib" / name).write_text(f"P0: {matrix}\nP2: {matrix}\n")
    return folder / "image_2", folder / "label_2"


def yolo(folder: Path, drawn: Sequence[Drawn]) -> tuple[Path, Path]:
    """Write them as YOLO: one box by its middle, one as a polygon, each with a distance behind."""
    drawn_roads.write_pictures(folder / "images", drawn)
    (folder / "labels").mkdir()
    for photo in drawn:
        lines = []
        for n, (ahead, _, _) in enumerate(photo.boxes):
            x0, y0, x1, y1 = (a / b for a, b in zip(photo.corners(n), (WIDTH, HEIGHT, WIDTH, HEIGHT), strict=True))
            box = f"{(x0 + x1) / 2} {(y0 + y1) / 2} {x1 - x0} {y1 - y0}"
            lines.append(f"0 {f'{x0} {y0} {x1} {y0} {x1} {y1} {x0} {y1}' if n else box} {ahead}")
        (folder / "labels" / photo.file.replace(".png", ".txt")).write_text("\n".join(lines))
    (folder / "labels" / "classes.txt").write_text("car\n")
    return folder / "images", folder / "labels"


def coco(folder: Path, drawn: Sequence[Drawn]) -> tuple[Path, Path]:
    """Write them as COCO: masks as a polygon and as runs, distances as attributes."""
    drawn_roads.write_pictures(folder / "images", drawn)
    found = []
    for photo in drawn:
        for n, (ahead, _, _) in enumerate(photo.boxes):
            x0, y0, x1, y1 = photo.corners(n)
            mask = np.zeros((HEIGHT, WIDTH), np.bool_)
            mask[y0:y1, x0:x1] = True
            flat = mask.T.ravel()
            ends = np.flatnonzero(np.diff(flat.astype(int))) + 1
            runs = np.diff([0, *ends.tolist(), flat.size]).tolist()
            masks = {"size": [HEIGHT, WIDTH], "counts": runs} if n else [[x0, y0, x1, y0, x1, y1, x0, y1]]
            said = {"distance_m": ahead, "occluded": False}
            found.append(
                {
                    "id": len(found),
                    "image_id": photo.file,
                    "bbox": [x0, y0, x1 - x0, y1 - y0],
                    "category_id": 1,
                    "segmentation": masks,
                    "attributes": said,
                }
            )
    images = [{"id": one.file, "file_name": one.file, "width": WIDTH} for one in drawn]
    whole = {"images": images, "annotations": found, "categories": [{"id": 1, "name": "car"}], "info": {}}
    (folder / "instances.json").write_text(json.dumps(whole))
    return folder / "images", folder / "instances.json"


def mot(folder: Path, drawn: Sequence[Drawn]) -> tuple[Path, Path]:
    """Write them as MOT: pixels from 1, with confidence, class and visible share."""
    drawn_roads.write_pictures(folder / "drive-7" / "img1", drawn)
    lines = []
    for photo in drawn:
        for n in range(len(photo.boxes)):
            x0, y0, x1, y1 = photo.corners(n)
            lines.append(f"{int(photo.file[:6])},{n},{x0 + 1},{y0 + 1},{x1 - x0},{y1 - y0},1,3,{0.6 if n else 1}")
    (folder / "gt.txt").write_text("\n".join(lines))
    return folder / "drive-7" / "img1", folder / "gt.txt"


def nuscenes(folder: Path, drawn: Sequence[Drawn]) -> tuple[Path, Path]:
    """Write them as nuScenes: x is ahead and z up, the vehicle is turned in the world, the camera looks ahead."""
    drawn_roads.write_pictures(folder / "samples" / "CAM_FRONT", drawn)
    tables: dict[str, list[dict[str, object]]] = {
        "sensor": [{"token": "s", "channel": "CAM_FRONT"}, {"token": "l", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [
            {
                "token": "c",
                "sensor_token": "s",
                "translation": [1.0, 0, EYE_M],
                "rotation": [0.5, -0.5, 0.5, -0.5],
                "camera_intrinsic": [[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HORIZON], [0, 0, 1]],
            },
            {
                "token": "d",
                "sensor_token": "l",
                "translation": [0, 0, 2],
                "rotation": [1, 0, 0, 0],
                "camera_intrinsic": [],
            },
        ],
        "log": [{"token": "g", "location": "harbour"}],
        "scene": [{"token": "e", "name": "scene-0061", "log_token": "g"}],
        **{name: [] for name in ("ego_pose", "sample", "sample_data", "sample_annotation")},
    }
    half = math.sqrt(0.5)
    for n, photo in enumerate(drawn):
        tables["ego_pose"].append({"token": f"p{n}", "translation": [100.0, 50.0, 0], "rotation": [half, 0, 0, half]})
        tables["sample"].append({"token": f"a{n}", "timestamp": 100 - n, "scene_token": "e"})
        for token, mount, file in ((f"d{n}", "c", f"samples/CAM_FRONT/{photo.file}"), (f"l{n}", "d", "samples/x.bin")):
            tables["sample_data"].append(
                {
                    "token": token,
                    "sample_token": f"a{n}",
                    "ego_pose_token": f"p{n}",
                    "calibrated_sensor_token": mount,
                    "filename": file,
                    "is_key_frame": True,
                    "width": WIDTH,
                    "height": HEIGHT,
                }
            )
        for ahead, left, _ in photo.boxes:  # the world's y is the vehicle's x, turned by 90 degrees to the left
            tables["sample_annotation"].append(
                {
                    "token": f"b{n}{ahead}",
                    "sample_token": f"a{n}",
                    "size": [1.5, 0.02, 1.2],
                    "visibility_token": "4",
                    "translation": [100.0 - left, 50.0 + 1.0 + ahead + 0.01, 0.6],
                    "rotation": [half, 0, 0, half],
                }
            )
    (folder / "v1.0-mini").mkdir()
    for name, rows in tables.items():
        (folder / "v1.0-mini" / f"{name}.json").write_text(json.dumps(rows))
    return folder, folder / "v1.0-mini"


WRITERS: dict[str, Callable[[Path, Sequence[Drawn]], tuple[Path, Path]]] = {
    "kitti": kitti,
    "nuscenes": nuscenes,
    "coco": coco,
    "yolo": yolo,
    "mot": mot,
}
