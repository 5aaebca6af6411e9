"""The flat reference geometry: generate, read, check and number meshes; elements; `Cloth`."""
