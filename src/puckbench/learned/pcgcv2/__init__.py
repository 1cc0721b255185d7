"""PCGCv2: multiscale learned point-cloud geometry coding (Wang, Ding, Li, Ma 2021)."""
