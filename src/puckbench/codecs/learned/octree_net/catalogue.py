"""How the learned octree coder's weights are called."""

from __future__ import annotations

from puckbench.codecs.learned.catalogue import Network

NETWORK = Network("sparse_octree_net")
