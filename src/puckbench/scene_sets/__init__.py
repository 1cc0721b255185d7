"""Scene sets: scenes (meshes, clouds or returns) of one source, generated or on disk.

To add a scene set, register its loader, which is a class in a file here or elsewhere
(``path/to/file.py:Class``). A folder of mesh files needs only::

    @LOADERS.register("mine")
    class Mine(MeshFolderSet):
        licence, credit, expected = "CC-BY 4.0", "me", "expected my meshes (.obj)"

        def listed(self, folder: Path) -> Mapping[str, Path]:
            return {path.stem: path for path in sorted(folder.glob("*.obj"))}

        def group_of(self, path: Path) -> str:
            return "object"
"""
