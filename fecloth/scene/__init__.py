"""Scenes: TOML files turned into objects, and messages about their mistakes."""
