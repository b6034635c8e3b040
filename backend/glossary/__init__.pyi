from .glossary import render_glossary_typescript

__all__ = [
    "render_glossary_typescript",
]
