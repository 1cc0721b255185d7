"""Data sets, generated and on disk: one file each.

A new one is one file here (or anywhere, named ``path/to/file.py:Class``) with one class that is
registered above it; where each scene is a mesh file below a folder, it needs only::

    @LOADERS.register("mine")
    class Mine(MeshFolderSet):
        provenance = Provenance("CC-BY 4.0", "me", "my meshes should lie there")

        def _listed(self, folder: Path) -> Mapping[str, Path]:
            return {path.stem: path for path in sorted(folder.glob("*.obj"))}

        def _group(self, path: Path) -> str:
            return "object"
"""
