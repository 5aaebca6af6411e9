"""A scene run into a folder: tables, frames, restart files, the outcome."""
