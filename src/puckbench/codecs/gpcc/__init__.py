"""G-PCC geometry (ISO/IEC 23090-9, first edition): octree coding that the reference software reads.

`coder` codes and decodes whole streams, `lossless` packs voxels for other codecs; below them stand
`syntax` (parameter sets, data unit), `arithmetic` (entropy coder) and `octree` (the tree).
The names are the standard's, or those of its reference software TMC13 release-v14.0.
"""
