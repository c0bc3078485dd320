"""Render the photographs of docs/photographs: textured streets with shadows, in the form of KITTI.

Usage: pip install mujoco==4.0.0 && MUJOCO_GL=egl python docs/make_photographs.py docs/photographs

MuJoCo (Todorov et al. 2012) draws them on any processor; eyechart itself does not need it. Every
texture is drawn here, so that no picture of anybody else is in them. Boxes, distances and what hides
what are those of the scene. Metres: x to the right, y ahead, z up; the camera is at x = y = 0.
"""

import csv
import io
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

FOCAL_PX, EYE_M, LANE_M = 300.0, 1.65, 3.5
WIDTH, ABOVE, BELOW = 480, 80, 128
"""The picture's columns, and its rows above and below the horizon."""
FINER = 2
"""Rows and columns are drawn so many times finer, and averaged."""
QUALITY = 82
NOISE = 1.5
SIDE = 256
"""Rows and columns of a texture that covers a thing."""

RED, BLUE, GREEN, YELLOW, ORANGE = (168, 26, 24), (28, 62, 158), (24, 104, 52), (206, 164, 20), (204, 92, 18)
PAINTS = (RED, BLUE, GREEN, YELLOW, ORANGE)
BRICKS = ((150, 92, 74), (172, 150, 120), (120, 112, 108), (176, 128, 92), (140, 80, 70))

Colour = tuple[int, int, int]
Texture = np.ndarray


def cloud(rng: np.random.Generator, rows: int, columns: int, steep: float) -> np.ndarray:
    """Return noise (rows, columns) without an edge, whose strength falls with frequency this steeply."""
    across, along = np.fft.rfftfreq(columns)[None] * columns, np.fft.fftfreq(rows)[:, None] * rows
    frequency = np.hypot(along, across)
    frequency[0, 0] = 1
    waves = np.exp(2j * np.pi * rng.random(frequency.shape)) * frequency**-steep
    waves[0, 0] = 0
    noise = np.fft.irfft2(waves, (rows, columns))
    return np.asarray(noise / noise.std())


def tinted(colour: Sequence[float], *layers: np.ndarray) -> Texture:
    """Return a texture (h, w, 3) of one colour, lighter and darker by layers (h, w)."""
    return np.asarray(colour, np.float64) + sum(layers)[..., None]


@cache
def road() -> Texture:
    """Return 7 m by 7 m of asphalt with worn lines and the traces of wheels."""
    rng = np.random.default_rng(7)
    side = 1024
    made = tinted((104, 102, 100), 7 * cloud(rng, side, side, 1.2), 9 * rng.standard_normal((side, side)))
    at = (np.arange(side) + 0.5) / side * 7
    for wheel in (-2.5, -1.0, 1.0, 2.5):
        made -= 9 * np.exp(-(((at - 3.5 - wheel) / 0.35) ** 2))[None, :, None]
    lines = np.abs(np.abs(at - 3.5) - 3.3)[None] < 0.06
    lines = lines | ((np.abs(at - 3.5) < 0.06)[None] & (at < 3)[:, None])
    made[lines & (cloud(rng, side, side, 0.8) < 1.1)] = 205
    made[lines] += 8 * rng.standard_normal((lines.sum(), 1))
    return made


@cache
def grass() -> Texture:
    """Return grass."""
    rng = np.random.default_rng(7)
    made = tinted((82, 98, 52), 12 * cloud(rng, 512, 512, 0.9), 12 * rng.standard_normal((512, 512)))
    made[..., 0] += 6 * cloud(rng, 512, 512, 1.2)
    return made


@cache
def paving() -> Texture:
    """Return slabs in rows that are set off by half."""
    rng = np.random.default_rng(7)
    made = tinted((150, 145, 138), 6 * cloud(rng, 512, 512, 1.0), 6 * rng.standard_normal((512, 512)))
    for row in range(0, 512, 64):
        made[row : row + 2] -= 45
        for column in range(row // 64 % 2 * 32, 512, 64):
            made[row : row + 64, column : column + 64] += 5 * rng.standard_normal()
            made[row : row + 64, column : column + 2] -= 45
    return made


@cache
def concrete() -> Texture:
    """Return concrete with joints and stains."""
    rng = np.random.default_rng(7)
    made = tinted((142, 140, 134), 9 * cloud(rng, 512, 512, 1.4), 6 * rng.standard_normal((512, 512)))
    made[:3] -= 50
    made[:, :3] -= 50
    return made


def house(rng: np.random.Generator, colour: Colour) -> Texture:
    """Return a wall of bricks with two rows of windows."""
    high, wide = 256, 384
    made = tinted(colour, 5 * cloud(rng, high, wide, 1.0), 6 * rng.standard_normal((high, wide)))
    for row in range(0, high, 8):
        made[row] -= 22
        made[row : row + 8, (np.arange(0, wide, 16) + row // 8 % 2 * 8) % wide] -= 22
    for row in (30, 140):
        for column in (40, 150, 265):
            made[row - 6 : row + 74, column - 6 : column + 66] = tinted((205, 200, 190), np.zeros((80, 72)))
            made[row : row + 68, column : column + 60] = pane(rng, 68, 60)
            made[row : row + 68, column + 28 : column + 32] = made[row + 30 : row + 34, column : column + 60] = 205
    return made


def container(rng: np.random.Generator, colour: Colour) -> Texture:
    """Return ribbed sheet metal with rust."""
    ribs = 16 * np.sign(np.sin(np.arange(SIDE) / SIDE * 2 * np.pi * 18))[None] * np.ones((SIDE, 1))
    made = tinted(colour, ribs, 6 * cloud(rng, SIDE, SIDE, 1.2))
    made[cloud(rng, SIDE, SIDE, 1.5) > 1.7] = (96, 58, 38)
    return made


def crate(rng: np.random.Generator, colour: Colour) -> Texture:
    """Return boards in a frame."""
    made = tinted(colour, 10 * cloud(rng, SIDE, SIDE, 0.9), 12 * cloud(rng, SIDE, 1, 0.5) * np.ones((1, SIDE)))
    for row in range(0, SIDE, 42):
        made[row : row + 4] -= 60
    for part in (np.s_[:24], np.s_[-24:], np.s_[:, :24], np.s_[:, -24:]):
        made[part] += 18
    return made


def leaves(rng: np.random.Generator) -> Texture:
    """Return leaves."""
    return tinted((62, 84, 38), 24 * cloud(rng, SIDE, SIDE, 0.6), 18 * rng.standard_normal((SIDE, SIDE)))


def pane(rng: np.random.Generator, high: int = SIDE, wide: int = SIDE) -> Texture:
    """Return glass, darker towards its foot."""
    grey = np.linspace(95, 45, high)[:, None] + 8 * cloud(rng, high, wide, 1.6)
    return np.dstack([0.86 * grey, 0.96 * grey, 1.05 * grey])


def rear(rng: np.random.Generator, colour: Colour, *, window: bool) -> Texture:
    """Return the rear of a vehicle: lamps, a plate, a bumper, and a window if it is tall."""
    made = tinted(colour, 3 * cloud(rng, SIDE, SIDE, 1.3)) + np.linspace(18, -30, SIDE)[:, None, None]
    if window:
        made[24:100, 24:232] = pane(rng, 76, 208)
        made[:, 126:130] -= 40
    made[115:158, 6:36] = made[115:158, 220:250] = (150, 18, 16)
    made[158:190, 98:158], made[168:180, 104:152:6] = (220, 214, 190), 40
    made[210:] = 34
    return made


def flank(rng: np.random.Generator, colour: Colour) -> Texture:
    """Return the side of a vehicle."""
    made = tinted(colour, 3 * cloud(rng, SIDE, SIDE, 1.3)) + np.linspace(18, -34, SIDE)[:, None, None]
    made[:, 80:82] -= 40
    made[:, 160:162] -= 40
    made[218:] = 36
    return made


@dataclass(frozen=True)
class Thing:
    """An annotated thing: its name, kind, place and size in metres; ``y`` is its near side."""

    name: str
    kind: str
    x: float
    y: float
    width: float
    high: float
    long: float


@dataclass
class World:
    """A scene that is filled with things and photographed; ``behind`` is how far it has passed by, in metres."""

    rng: np.random.Generator
    behind: float = 0.0
    sun: tuple[float, float, float] = (0.35, 0.3, -1.0)
    wet: float = 0.0
    things: list[Thing] = field(default_factory=list)
    _files: dict[str, bytes] = field(default_factory=dict)
    _assets: list[str] = field(default_factory=list)
    _geoms: list[str] = field(default_factory=list)

    def cover(self, name: str, made: Texture, *, repeat: tuple[int, int] = (0, 0), shine: float = 0.05) -> str:
        """Add a texture as a material, repeated on the ground or wrapped around a thing; return its name."""
        image = Image.fromarray(np.clip(made, 0, 255).astype(np.uint8))
        flat, stored = repeat[0] > 0, io.BytesIO()
        (image if flat else image.resize((SIDE, SIDE), Image.Resampling.LANCZOS)).save(stored, "PNG")
        self._files[f"{name}.png"] = stored.getvalue()
        often = f'texrepeat="{repeat[0]} {repeat[1]}"' if flat else ""
        mirrors = f'reflectance="{self.wet}"' if name == "road" else ""
        self._assets.append(
            f'<texture name="{name}" type="{"2d" if flat else "cube"}" file="{name}.png"/>'
            f'<material name="{name}" texture="{name}" {often} {mirrors} specular="{shine}" shininess=".4"/>'
        )
        return name

    def put(
        self,
        name: str,
        shape: str,
        size: Sequence[float],
        at: Sequence[float],
        look: str,
        turned: Sequence[float] = (0, 0, 0),
    ) -> None:
        """Add a body; ``look`` is a material, or numbers of a plain colour."""
        words = [" ".join(f"{one:.4f}" for one in many) for many in (size, at, turned)]
        painted = f'rgba="{look}"' if " " in look else f'material="{look}"'
        self._geoms.append(
            f'<geom name="{name}#{len(self._geoms)}" type="{shape}" size="{words[0]}" pos="{words[1]}" '
            f'euler="{words[2]}" {painted}/>'
        )

    def ground(self, verge: Callable[[], Texture], *, over: Callable[[], Texture] = road) -> None:
        """Lay a road of two lanes, the own one on the right, and a verge on each side."""
        middle = 100 - self.behind % 7
        self.cover("road", over(), repeat=(1, 30))
        self.cover("verge", verge(), repeat=(2, 100))
        self.cover("grass", grass(), repeat=(20, 40))
        self.put("ground", "plane", (3.5, 105, 0.1), (-1.75, middle, 0), "road")
        for x in (-7.25, 3.75):
            self.put("ground", "plane", (2, 105, 0.1), (x, middle, 0), "verge")
        self.put("ground", "plane", (90, 140, 0.1), (0, 100, -0.3), "grass")

    def houses(self, x: float, away: int) -> None:
        """Build a row of houses whose fronts are at x."""
        y = 3.0 - self.behind
        while y < 95:
            long, high = float(self.rng.uniform(8, 13)), float(self.rng.uniform(5.5, 9))
            look = self.cover(f"house{len(self._assets)}", house(self.rng, BRICKS[self.rng.integers(len(BRICKS))]))
            if y + long > 1:
                self.put("wall", "box", (4, long / 2, high / 2), (x + away * 4, y + long / 2, high / 2), look)
            y += long

    def containers(self, x: float, away: int) -> None:
        """Set down a row of containers."""
        y = 4.0 - self.behind
        while y < 80:
            colour = ((120, 52, 40), (52, 84, 110), (70, 98, 70), (140, 120, 60))[self.rng.integers(4)]
            look = self.cover(f"container{len(self._assets)}", container(self.rng, colour))
            high = 1.3 if self.rng.random() < 0.6 else 2.6
            if y + 6 > 1:
                self.put("wall", "box", (1.2, 3.0, high), (x + away * 1.2, y + 3.0, high), look)
            y += 6.0 + float(self.rng.uniform(0.3, 2.5))

    def trees(self, x: float, first: float, apart: float) -> None:
        """Plant a row of trees."""
        look, bark = self.cover(f"leaves{len(self._assets)}", leaves(self.rng)), "0.30 0.24 0.18 1"
        for place in range(7):
            y, high = first + place * apart - self.behind, float(self.rng.uniform(5, 7))
            blobs = [(self.rng.normal(0, 0.75, 3), self.rng.uniform(0.7, 1.3)) for _ in range(9)]
            if y > 2:
                self.put("tree", "cylinder", (0.16, high / 4), (x, y, high / 4), bark)
                for (right, ahead, up), wide in blobs:
                    at = (x + right, y + ahead, 0.68 * high + up)
                    self.put("tree", "ellipsoid", (wide, wide, 0.8 * wide), at, look)

    def vehicle(self, one: Thing, colour: Colour, up: float = 0.0) -> None:
        """Put a car, or a van or a truck as tall as it says, whose rear is at ``one.y``."""
        self.things.append(one)
        tall, off = one.kind != "Car", 0.22
        body = one.high if tall else 0.62 * one.high
        back = self.cover(f"{one.name}-rear", rear(self.rng, colour, window=tall), shine=0.3)
        side = self.cover(f"{one.name}-side", flank(self.rng, colour), shine=0.3)
        half, middle, rise = (body - off) / 2, one.y + one.long / 2, up + off
        self.put(one.name, "box", (one.width / 2, 0.03, half), (one.x, one.y + 0.03, rise + half), back)
        self.put(one.name, "box", (one.width / 2, one.long / 2 - 0.06, half), (one.x, middle, rise + half), side)
        if not tall:
            glass, roof = self.cover(f"{one.name}-glass", pane(self.rng), shine=0.6), (one.high - body) / 2
            size = (0.42 * one.width, 0.26 * one.long, roof - 0.02)
            self.put(one.name, "box", size, (one.x, middle - 0.15, up + body + roof - 0.02), glass)
            size = (0.40 * one.width, 0.22 * one.long, 0.025)
            self.put(one.name, "box", size, (one.x, middle - 0.1, up + one.high - 0.02), side)
        for right in (-1, 1):
            for ahead in (-1, 1):
                at = (one.x + right * (one.width / 2 - 0.12), middle + ahead * 0.31 * one.long, up + 0.32)
                self.put(one.name, "cylinder", (0.32, 0.11), at, "0.06 0.06 0.065 1", (0, 90, 0))

    def box(self, one: Thing, colour: Colour) -> None:
        """Put a crate."""
        self.things.append(one)
        look = self.cover(one.name, crate(self.rng, colour))
        at = (one.x, one.y + one.long / 2, one.high / 2)
        self.put(one.name, "box", (one.width / 2, one.long / 2, one.high / 2), at, look)

    def walker(self, one: Thing, colour: Colour) -> None:
        """Put a person."""
        self.things.append(one)
        coat, y = " ".join(f"{level / 255:.3f}" for level in colour) + " 1", one.y + 0.2
        for side in (-1, 1):
            at = (one.x + 0.11 * side, y + 0.12 * side, 0.44)
            self.put(one.name, "capsule", (0.085, 0.36), at, "0.15 0.16 0.22 1", (14 * side, 0, 0))
            at = (one.x + 0.29 * side, y - 0.08 * side, 1.1)
            self.put(one.name, "capsule", (0.06, 0.26), at, coat, (-16 * side, 0, 0))
        self.put(one.name, "ellipsoid", (0.24, 0.16, 0.36), (one.x, y, 1.12), coat)
        self.put(one.name, "sphere", (0.125,), (one.x, y, 1.62), "0.75 0.58 0.47 1")

    def photograph(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the picture (h, w, 3) and what each of its pixels shows (h, w), by name."""
        model = mujoco.MjModel.from_xml_string(self._scene(), self._files)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with mujoco.Renderer(model, 2 * BELOW * FINER, WIDTH * FINER, max_geom=4000) as renderer:
            renderer.update_scene(data, "front")
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
            fine = renderer.render().astype(np.float64)
            renderer.enable_segmentation_rendering()
            renderer.update_scene(data, "front")
            shown = renderer.render()[FINER // 2 :: FINER, FINER // 2 :: FINER]
        picture = fine.reshape(2 * BELOW, FINER, WIDTH, FINER, 3).mean(axis=(1, 3))
        picture += NOISE * self.rng.standard_normal(picture.shape)
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, one).split("#")[0] for one in range(model.ngeom)]
        number = np.where(shown[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, shown[..., 0], model.ngeom)
        top = BELOW - ABOVE
        return np.clip(picture[top:], 0, 255).astype(np.uint8), np.array([*names, "sky"])[number][top:]

    def _scene(self) -> str:
        angle = 2 * math.degrees(math.atan(BELOW / FOCAL_PX))
        return f"""<mujoco><compiler angle="degree"/><statistic extent="60" center="0 25 0"/>
<visual><global offwidth="{WIDTH * FINER}" offheight="{2 * BELOW * FINER}"/><quality shadowsize="8192"/>
<map znear=".005" zfar="6" shadowclip="1.8" fogstart="1.2" fogend="3.5"/><rgba fog=".78 .82 .86 1"/>
<headlight ambient=".34 .36 .40" diffuse="0 0 0" specular="0 0 0"/></visual>
<asset><texture type="skybox" builtin="gradient" rgb1=".45 .60 .82" rgb2=".86 .89 .92" width="512" height="512"/>
{"".join(self._assets)}</asset>
<worldbody><light type="directional" castshadow="true" pos="0 25 40" dir="{" ".join(map(str, self.sun))}"
 diffuse=".72 .72 .70" specular=".2 .2 .2"/>
<camera name="front" pos="0 0 {EYE_M}" xyaxes="1 0 0 0 0 1" fovy="{angle}"/>{"".join(self._geoms)}
</worldbody></mujoco>"""


def street(world: World) -> None:
    """Make a street between houses, with cars at the kerb."""
    world.ground(paving)
    world.houses(5.9, 1)
    world.houses(-9.4, -1)
    world.trees(-6.4, 9, 12)
    colour = PAINTS[world.rng.integers(len(PAINTS))]
    for number, y in enumerate((16.0, 34.0, 47.0)):
        if y - world.behind > 4:
            world.vehicle(Thing(f"parked{number}", "Car", 4.6, y - world.behind, 1.8, 1.45, 4.2), colour)


def avenue(world: World) -> None:
    """Make a country road whose trees throw their shadows across it."""
    world.ground(grass)
    world.trees(-7.2, 6, 9)
    world.trees(4.3, 10, 11)


def yard(world: World) -> None:
    """Make a yard of concrete between containers."""
    world.ground(concrete, over=concrete)
    world.containers(5.6, 1)
    world.containers(-9.2, -1)


SCENES = {"street": street, "avenue": avenue, "yard": yard}
SUNS = ((0.3, 0.25, -1.0), (0.35, -0.3, -1.0), (-0.3, 0.3, -1.0), (0.2, -0.35, -1.0))
GAPS = (7.2, 9.2, 11.6, 14.2, 17.0)
EPISODES = 4
Shown = tuple[World, dict[str, str]]
"""A world, and the cells of its row: scenario, episode, step, beside, clear_to_m."""


def lead(kind: str, x: float, y: float) -> Thing:
    """Return what is ahead, by its kind."""
    sizes = {"Car": (1.8, 1.5, 4.3), "Van": (1.9, 1.9, 4.6), "Misc": (1.5, 1.4, 1.5), "Pedestrian": (0.7, 1.75, 0.4)}
    return Thing("lead", kind, x, y, *sizes[kind])


def put(world: World, thing: Thing, colour: Colour) -> None:
    """Put a thing of any kind."""
    {"Misc": world.box, "Pedestrian": world.walker}.get(thing.kind, world.vehicle)(thing, colour)


def episodes() -> Iterator[Shown]:
    """Yield five moments of four episodes in each scene; the gaps follow no order in time."""
    for place, (scenario, build) in enumerate(SCENES.items()):
        for episode in range(EPISODES):
            drawn = np.random.default_rng([place, episode])
            gaps, kinds = drawn.permutation(GAPS) * drawn.uniform(0.97, 1.03, len(GAPS)), ("Car", "Van")
            if scenario == "yard":
                kinds = ("Misc", "Car")
            kind, colour, x = kinds[episode % 2], PAINTS[drawn.integers(len(PAINTS))], drawn.uniform(-0.3, 0.3)
            if (scenario, episode) == ("avenue", 3):
                kind = "Pedestrian"
            for step, gap in enumerate(gaps):
                world = World(np.random.default_rng([place, episode]), 2.5 * step, SUNS[(place + episode) % len(SUNS)])
                build(world)
                put(world, lead(kind, float(x), round(float(gap), 2)), colour)
                oncoming = step == 2 and episode % 2 == 1
                if oncoming:
                    put(world, replace(lead("Car", -3.5, 21.0), name="oncoming"), BLUE)
                cells = {"episode": f"{scenario}-{episode}", "step": str(step), "scenario": scenario}
                yield world, cells | {"beside": "" if oncoming else "left", "clear_to_m": "70"}


def odd() -> Iterator[Shown]:
    """Yield six pictures that are refused, whole or in part, and two that only a person can refuse."""

    def shown(build: Callable[[World], None], things: Sequence[tuple[Thing, Colour]], **more: object) -> World:
        world = World(np.random.default_rng(99), **more)  # type: ignore[arg-type]
        build(world)
        for thing, colour in things:
            put(world, thing, colour)
        return world

    car = lead("Car", 0.1, 11.0)
    truck, near, far = Thing("lead", "Truck", 0.0, 12.0, 2.4, 3.6, 7.5), replace(car, y=3.6), replace(car, y=30.0)
    hidden, before = Thing("lead", "Car", 0.8, 14.0, 1.8, 1.5, 4.3), Thing("before", "Van", 1.85, 9.0, 1.9, 1.9, 4.6)
    cells = {"beside": "left", "clear_to_m": "70", "scenario": "odd", "step": "0"}
    for number, (world, more) in enumerate(
        (
            (shown(street, [(truck, ORANGE)]), {}),
            (shown(avenue, [(near, RED)]), {}),
            (shown(avenue, [(far, RED)]), {}),
            (shown(yard, [(hidden, RED), (before, BLUE)]), {}),
            (_on_a_hill(car), {}),
            (_before_a_wall(car), {"clear_to_m": "22", "beside": ""}),
            (shown(avenue, [(car, RED)], sun=(1.0, 0.1, -0.32)), {}),
            (shown(street, [(car, RED)], wet=0.35), {}),
        )
    ):
        yield world, cells | {"episode": f"odd-{number}"} | more


def _on_a_hill(car: Thing) -> World:
    """Return a world in which the road rises before the car."""
    world = World(np.random.default_rng(99))
    avenue(world)
    steep, foot = 6.0, 7.0
    half = 40.0
    at = (-1.75, foot + half * math.cos(math.radians(steep)), half * math.sin(math.radians(steep)) + 0.01)
    world.put("ground", "plane", (3.5, half, 0.1), at, "road", (steep, 0, 0))
    world.vehicle(car, RED, up=(car.y - foot) * math.tan(math.radians(steep)))
    return world


def _before_a_wall(car: Thing) -> World:
    """Return a world whose road ends at a wall."""
    world = World(np.random.default_rng(99))
    yard(world)
    world.vehicle(car, YELLOW)
    look = world.cover("end", house(world.rng, BRICKS[0]))
    world.put("wall", "box", (8, 0.3, 2.2), (-1.75, 24.3, 2.2), look)
    return world


def label(thing: Thing, world: World, shown: np.ndarray) -> str:
    """Return the line of a thing in a file of KITTI's labels; empty if it is not seen."""
    mask = shown == thing.name
    rows, columns = (np.flatnonzero(mask.any(axis=side)) for side in (1, 0))
    if len(rows) < 2 or len(columns) < 2:
        return ""
    x0, y0, x1, y1 = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
    nearer = [one for one in world.things if one.y < thing.y]
    left, right = (WIDTH / 2 + FOCAL_PX * (thing.x + side * thing.width / 2) / thing.y for side in (-1, 1))
    whole = max(right - left, 1.0)
    outside = max(-left, 0.0) + max(right - WIDTH, 0.0)
    covered = sum(
        max(
            min(right, WIDTH / 2 + FOCAL_PX * (one.x + one.width / 2) / one.y)
            - max(left, WIDTH / 2 + FOCAL_PX * (one.x - one.width / 2) / one.y),
            0.0,
        )
        for one in nearer
    )
    occluded = 0 if covered < 0.05 * whole else 1 if covered < 0.5 * whole else 2
    size = f"{thing.high:.2f} {thing.width:.2f} {thing.long:.2f}"
    place = f"{thing.x:.2f} {EYE_M:.2f} {thing.y + thing.long / 2:.2f}"
    return (
        f"{thing.kind} {min(outside / whole, 1):.2f} {occluded} 0.00 {x0:.2f} {y0:.2f} {x1:.2f} {y1:.2f} {size} "
        f"{place} -1.57"
    )


def main(folder: Path) -> None:
    """Write pictures, labels and calibrations, and two tables: of the drives, and of the odd pictures."""
    tables: dict[str, list[dict[str, str]]] = {"photos.csv": [], "odd.csv": []}
    for name in ("image_2", "label_2", "calib"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for number, (world, cells) in enumerate(chain(episodes(), odd())):
        name = f"{number:06d}"
        picture, shown = world.photograph()
        Image.fromarray(picture).save(folder / "image_2" / f"{name}.webp", quality=QUALITY, method=6)
        lines = [line for one in world.things if (line := label(one, world, shown))]
        (folder / "label_2" / f"{name}.txt").write_text("".join(f"{line}\n" for line in lines))
        lens = f"{FOCAL_PX:g} 0 {WIDTH / 2:g} 0 0 {FOCAL_PX:g} {ABOVE} 0 0 0 1 0"
        (folder / "calib" / f"{name}.txt").write_text(f"P2: {lens}\n")
        tables["odd.csv" if cells["scenario"] == "odd" else "photos.csv"].append({"file": f"{name}.webp", **cells})
        print(name, *cells.values(), flush=True)  # noqa: T201 - it takes minutes
    for name, rows in tables.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            columns = ("file", "episode", "step", "scenario", "beside", "clear_to_m")
            writer = csv.DictWriter(file, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
