"""Many frames of one scene: by this process, by several on this machine, or by the workers of a Dask cluster.

`running.draw_frames` is what the commands `turntable` and `animate` call.
"""
