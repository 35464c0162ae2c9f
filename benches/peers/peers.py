"""Mitsuba 3 and `tyndall render --model path` on one scene: do they agree, and what does equal error cost each? And what
does a picture of `--model multiple` cost beside them?

Run by benches/peers/run, which makes the environment; benches/peers/README.md says what is measured and how.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np


def cpu_seconds(who):
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def mitsuba_scene(folder):
    """The exported scene in Mitsuba's terms."""
    d = json.loads((folder / "scene.json").read_text())
    nx, ny, nz = d["dims"]
    grid = np.fromfile(folder / "extinction.f32", dtype="<f4").reshape(nz, ny, nx, 1)
    x, y, z, corner = (np.array(v) for v in d["index_to_world"])
    # Mitsuba's grid fills the unit cube, voxel i at (i + 1/2) / n: from there to the world.
    to_world = np.eye(4)
    to_world[:3, :4] = np.stack([x * nx, y * ny, z * nz, corner], axis=1)
    unit_to_world = mi.ScalarTransform4f(to_world)
    # Its cube goes from -1 to 1.
    cube_to_world = unit_to_world @ mi.ScalarTransform4f().scale(0.5) @ mi.ScalarTransform4f().translate([1, 1, 1])
    phase = {"type": "isotropic"} if d["g"] == 0 else {"type": "hg", "g": d["g"]}
    camera = d["camera"]
    eye = np.array(camera["position"])
    width, height = d["size"]
    scene = {
        "type": "scene",
        "integrator": {
            "type": "volpath",
            # Mitsuba counts the edges of a path: light scattered once has two.
            "max_depth": d["orders"] + 1,
            "rr_depth": d["orders"] + 1,
            # Tyndall's background is off.
            "hide_emitters": True,
        },
        "sensor": {
            "type": "perspective",
            "fov": camera["fov_degrees"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(
                origin=eye, target=eye + np.array(camera["forward"]), up=camera["up"]
            ),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
        "medium": {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(grid),
                "filter_type": "trilinear",
                "wrap_mode": "clamp",
                "to_world": unit_to_world,
            },
            "albedo": {"type": "constvolume", "value": rgb(d["albedo"])},
            "phase": phase,
        },
        "box": {
            "type": "cube",
            "to_world": cube_to_world,
            "bsdf": {"type": "null"},
            "interior": {"type": "ref", "id": "medium"},
        },
    }
    for i, light in enumerate(d["lights"]):
        if "direction" in light:
            emitter = {"type": "directional", "direction": light["direction"], "irradiance": rgb(light["irradiance"])}
        else:
            emitter = {"type": "point", "position": light["position"], "intensity": rgb(light["intensity"])}
        scene[f"light{i}"] = emitter
    if d["environment"]:
        scene["sky"] = {"type": "constant", "radiance": rgb(d["environment"])}
    return scene


def rgb(value):
    # Not "rgb", which an albedo would clamp and a spectral variant would upsample.
    return {"type": "rgb", "value": value}


class Mitsuba:
    """Renders with one variant; compiled and warm once it is made."""

    def __init__(self, variant, folder, spp):
        mi.set_variant(variant)
        self.name = f"mitsuba {mi.__version__} {variant}"
        self.variant = variant
        self.spp = spp
        self.scene = mi.load_dict(mitsuba_scene(folder))
        self.render(12345)

    def render(self, seed):
        """A picture, CPU and wall seconds."""
        mi.set_variant(self.variant)
        cpu, wall = cpu_seconds(resource.RUSAGE_SELF), time.perf_counter()
        picture = np.array(mi.render(self.scene, spp=self.spp, seed=seed), dtype=np.float64)
        return picture, cpu_seconds(resource.RUSAGE_SELF) - cpu, time.perf_counter() - wall


class Tyndall:
    """Renders with the command line. Every render is a process, so its set-up is measured too and taken off."""

    def __init__(self, tyndall, flags, folder, spp):
        self.spp = spp
        self.folder = folder
        self.command = [tyndall, "render", *flags, "--model", "path", "--background", "transparent"]
        self.run(1, 0)
        stats = json.loads((folder / "stats.json").read_text())
        self.name = "tyndall path"
        self.device = stats["device"]["driver"]

    def run(self, spp, seed):
        outputs = ["-q", "-o", self.folder / "picture.exr", "--stats", self.folder / "stats.json"]
        cpu = cpu_seconds(resource.RUSAGE_CHILDREN)
        subprocess.run([*self.command, "--spp", str(spp), "--seed", str(seed), *outputs], check=True)
        passes = json.loads((self.folder / "stats.json").read_text())["passes"]
        wall = sum(p["ms"] for p in passes if p["name"] == "path") / 1e3
        return cpu_seconds(resource.RUSAGE_CHILDREN) - cpu, wall

    def render(self, seed):
        """A picture, CPU and wall seconds."""
        idle = self.run(1, seed)
        busy = self.run(self.spp, seed)
        cpu, wall = ((b - i) * self.spp / (self.spp - 1) for b, i in zip(busy, idle))
        bitmap = mi.Bitmap(str(self.folder / "picture.exr"))
        return np.array(bitmap, dtype=np.float64)[:, :, :3], cpu, wall


class Multiple:
    """`--model multiple` at its defaults: whole processes, set-up included. Its frames of a turntable after the first take the
    camera's part."""

    name = "tyndall multiple"

    def __init__(self, tyndall, flags, folder):
        self.folder = folder
        self.command = [tyndall, "render", *flags, "--model", "multiple", "--background", "transparent"]
        self.shares = []
        self.render(0)

    def render(self, seed):
        """A picture, CPU and wall seconds."""
        outputs = ["-q", "-o", self.folder / "picture.exr", "--stats", self.folder / "stats.json"]
        cpu, wall = cpu_seconds(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([*self.command, "--seed", str(seed), *outputs], check=True)
        cpu, wall = cpu_seconds(resource.RUSAGE_CHILDREN) - cpu, time.perf_counter() - wall
        stats = json.loads((self.folder / "stats.json").read_text())
        camera = sum(p["ms"] for p in stats["passes"] if p["name"] == "camera")
        self.shares.append(camera / stats["gpu_ms"])
        bitmap = mi.Bitmap(str(self.folder / "picture.exr"))
        return np.array(bitmap, dtype=np.float64)[:, :, :3], cpu, wall


class Result:
    """What a renderer's independent pictures say."""

    def __init__(self, renderer):
        self.renderer = renderer
        self.pictures, self.cpus, self.walls = [], [], []

    def take(self, seed):
        picture, cpu, wall = self.renderer.render(seed)
        self.pictures.append(picture)
        self.cpus.append(cpu)
        self.walls.append(wall)

    def finish(self):
        self.mean = np.mean(self.pictures, axis=0)
        # Variance of one picture's pixels, and of the mean picture's.
        self.variance = np.var(self.pictures, axis=0, ddof=1)
        self.variance_of_mean = self.variance / len(self.pictures)
        self.cpu, self.wall = statistics.median(self.cpus), statistics.median(self.walls)
        self.mse = self.variance.mean()
        brightness = self.mean.mean()
        # CPU and wall seconds until the pixels' standard error is 1 % of the mean radiance.
        self.cpu_to_1, self.wall_to_1 = (t * self.mse / (0.01 * brightness) ** 2 for t in (self.cpu, self.wall))


def block_sums(picture, edge):
    height, width, channels = picture.shape
    h, w = height // edge, width // edge
    return picture[: h * edge, : w * edge].reshape(h, edge, w, edge, channels).sum(axis=(1, 3))


def compare(a, b):
    """z of the difference of the pictures' means per channel, and chi-square per block of 16 x 16 pixels."""
    pixels = a.mean.shape[0] * a.mean.shape[1]
    difference = (a.mean - b.mean).sum(axis=(0, 1)) / pixels
    variance = a.variance_of_mean + b.variance_of_mean
    error = np.sqrt(variance.sum(axis=(0, 1))) / pixels
    blocks, block_variance = block_sums(a.mean - b.mean, 16), block_sums(variance, 16)
    seen = block_variance > 0
    return difference / error, (blocks[seen] ** 2 / block_variance[seen]).mean()


def report(title, results, tyndall):
    print(f"\n{title}, {tyndall.renderer.device}")
    print(f"{'':32} {'spp':>5} {'CPU s':>8} {'range':>13} {'wall s':>8} {'noise %':>8} {'CPU s to 1 %':>13} {'ratio':>7} {'wall':>6}")
    for r in results:
        spread = f"{min(r.cpus):.2f}-{max(r.cpus):.2f}"
        noise = 100 * np.sqrt(r.mse) / r.mean.mean()
        ratio, wall = r.cpu_to_1 / tyndall.cpu_to_1, r.wall_to_1 / tyndall.wall_to_1
        print(
            f"{r.renderer.name:32} {r.renderer.spp:5} {r.cpu:8.2f} {spread:>13} {r.wall:8.2f} {noise:8.2f}"
            f" {r.cpu_to_1:13.1f} {ratio:7.2f} {wall:6.2f}"
        )
    agree = True
    for r in results:
        if r is tyndall:
            continue
        z, blocks = compare(tyndall, r)
        # Means of channels go together, so |z| < 4 is no loose bound. With few pictures a block's variance is
        # uncertain, and so is chi-square; a picture that is shifted or mirrored has hundreds.
        fine = bool(np.all(np.abs(z) < 4) and blocks < 2)
        agree = agree and fine
        means = " / ".join(f"{a:.5f} {b:.5f}" for a, b in zip(tyndall.mean.mean(axis=(0, 1)), r.mean.mean(axis=(0, 1))))
        print(f"{'agrees' if fine else 'DISAGREES'} with {r.renderer.name}: mean radiances {means};")
        print(f"  z {', '.join(f'{v:+.2f}' for v in z)}; chi-square per block of 16 x 16 pixels {blocks:.2f}")
    return agree


def report_multiple(multiple, results, path):
    """One picture's error against the mean of `path`, whose own noise is taken out, and what others take for as little."""
    brightness = path.mean.mean()
    squares = [((p - path.mean) ** 2 - path.variance_of_mean).mean() for p in multiple.pictures]
    # No error is below its own noise: where `path` is noisier than that, the estimate may be, and even below nothing.
    error2 = max(statistics.mean(squares), multiple.mse)
    bias = (multiple.mean - path.mean).mean(axis=(0, 1)) / path.mean.mean(axis=(0, 1))
    later = multiple.cpu * statistics.median(multiple.renderer.shares)
    print(
        f"{multiple.renderer.name}: {multiple.cpu:.2f} CPU s for a picture (set-up included), error"
        f" {100 * np.sqrt(error2) / brightness:.2f} %, noise {100 * np.sqrt(multiple.mse) / brightness:.2f} %,"
        f" bias {', '.join(f'{100 * b:+.2f}' for b in bias)} %; a later frame of a turntable {later:.2f} CPU s"
    )
    for r in results:
        seconds = r.cpu * r.mse / error2
        print(
            f"  {r.renderer.name} needs {seconds:.1f} CPU s for as small an error: {seconds / multiple.cpu:.1f} times the"
            f" picture, {seconds / later:.1f} times the later frame"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--title", required=True)
    parser.add_argument("--folder", type=Path, required=True, help="the exported scene")
    parser.add_argument("--tyndall", required=True, help="the binary")
    parser.add_argument("--variants", default="scalar_rgb,llvm_ad_rgb")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--spp", type=int, default=64, help="of Mitsuba")
    parser.add_argument("--tyndall-spp", type=int, default=256)
    parser.add_argument("flags", nargs="*", help="what the scene was exported with")
    args = parser.parse_args()

    variants = [v for v in args.variants.split(",") if v]
    results = [Result(Mitsuba(v, args.folder, args.spp)) for v in variants]
    tyndall = Result(Tyndall(args.tyndall, args.flags, args.folder, args.tyndall_spp))
    results.append(tyndall)
    # In turns, so that whatever else the machine does meets all alike.
    for run in range(args.runs):
        for r in results:
            r.take(run + 1)
    multiple = Result(Multiple(args.tyndall, args.flags, args.folder))
    for run in range(max(2, args.runs // 2)):
        multiple.take(run + 1)
    for r in [*results, multiple]:
        r.finish()
    agree = report(args.title, results, tyndall)
    report_multiple(multiple, results, tyndall)
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
