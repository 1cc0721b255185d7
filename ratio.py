import sys,numpy as np
from pathlib import Path
from puckbench.cloud import read_cloud
for p in sys.argv[1:]:
    x=np.rint(read_cloud(Path(p)).xyz).astype(np.int64); n=[]
    for k in range(7):
        v=x>>k; n.append(len(np.unique((v[:,0]<<40)|(v[:,1]<<20)|v[:,2])))
    n=np.array(n); print(Path(p).stem.ljust(16), len(x), n, np.round(n[1:]/n[:-1],2), 'cubes64', [len(np.unique(x>>(6+k),axis=0)) for k in range(4)])
