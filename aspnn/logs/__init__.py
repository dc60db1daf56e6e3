"""Recorded logs into the canonical form. Each importer returns checked logs; writing them is the caller's business."""

from aspnn.logs.esso_osaka import import_esso_osaka

__all__ = ["import_esso_osaka"]
