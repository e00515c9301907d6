"""The float64 reference: what an image should be, stage by stage, written for clarity and not for speed.

It shares nothing with the renderer but the scene model. `render(scene, settings)` returns an `OracleFrame`, `render_layers`
its further layers, `flow` the optical flow at pixels; the modules' public functions take one stage's inputs.
"""

from .flow import OracleFlow, flow
from .frame import OracleFrame, depth_at, nearest_depths, render
from .layers import OracleLayers, render_layers

__all__ = ["OracleFlow", "OracleFrame", "OracleLayers", "depth_at", "flow", "nearest_depths", "render", "render_layers"]
