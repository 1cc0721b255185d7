"""PCGCv1: learned point-cloud geometry coding with a hyper-prior (Wang, Zhu, Liu, Ma 2021)."""
