"""Scenes and the model files made from them."""

from .mjcf import write_mjcf
from .scene import Scene, SceneError, load_scene, scene_names
from .urdf import write_loops, write_urdf


def write_models(scene: Scene) -> dict[str, str]:
    """Every model file of a scene: name to text."""
    return {
        f"{scene.name}.xml": write_mjcf(scene),
        f"{scene.name}.urdf": write_urdf(scene),
        f"{scene.name}.loops.json": write_loops(scene),
    }


__all__ = [
    "Scene",
    "SceneError",
    "load_scene",
    "scene_names",
    "write_loops",
    "write_mjcf",
    "write_models",
    "write_urdf",
]
