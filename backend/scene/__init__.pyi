from .model import SCENE_PART, SceneMirror
from .proxy import create_scene_router

__all__ = [
    "SCENE_PART",
    "SceneMirror",
    "create_scene_router",
]
