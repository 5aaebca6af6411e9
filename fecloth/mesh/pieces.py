"""The pieces of a mesh: parts that share no node."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def piece_of_nodes(triangles: np.ndarray, n: int) -> np.ndarray:
    """Return the number of the piece of each of n nodes, in the order of their lowest nodes.

    Triangles (m, 3) connect the nodes; a node without a triangle is a piece of its own.
    """
    pairs = triangles[:, [0, 1, 1, 2]].reshape(-1, 2).T
    graph = coo_array((np.ones(pairs.shape[1], np.int8), pairs), shape=(n, n))
    piece: np.ndarray = connected_components(graph, directed=False)[1]
    return piece
