"""Everything that needs Blender; importable without it.

Blender's state is global and a mistake can end the process, so no other package imports bpy: `process.run_blender`
starts `worker` in a process of its own, which imports one of the modules that do.
"""
