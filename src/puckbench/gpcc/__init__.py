"""G-PCC geometry (ISO/IEC 23090-9, first edition): octree coding that TMC13 reads and writes.

`coder` encodes and decodes whole streams, `lossless` codes voxels for other codecs; below them are
`slices` (geometry data units), `octree` (levels, with `planar`, `idcm`, `neighbours` and
`occupancy`), `arithmetic` (entropy coder) and `syntax` (parameter sets and headers). Names are the
standard's, or those of its reference software TMC13 release-v14.0.
"""
