"""How PCGCv1's weights are called: ``a0.75b3.npz`` among the authors' archives has alpha 0.75."""

from __future__ import annotations

from puckbench.codecs.learned.catalogue import Network

NETWORK = Network("pcgcv1", r"a(\d+(?:\.\d+)?)b3\.npz")
