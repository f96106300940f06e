"""A screenshot of a result by ParaView: `pvpython demos/paraview.py FOLDER [PICTURE.png]`.

The blocks move by the collapse mode, which is written so that a warp by 1 shows it, and have the
colour of the larger compressive principal stress. The joints move with them: 0 open, 1 slip,
2 stick. FOLDER is what `fenics-contact solve` wrote.
"""

import sys
from pathlib import Path

from paraview.simple import (
    ColorBy,
    GetActiveViewOrCreate,
    GetColorTransferFunction,
    GetScalarBar,
    PVDReader,
    Render,
    ResetCamera,
    SaveScreenshot,
    Show,
    WarpByVector,
    XMLUnstructuredGridReader,
)

if len(sys.argv) < 2:
    sys.exit("give the folder of a result: pvpython demos/paraview.py demos/output/w3")
folder = Path(sys.argv[1]).resolve()
picture = Path(sys.argv[2] if len(sys.argv) > 2 else folder / "paraview.png").resolve()

view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [1600, 1000]
view.OrientationAxesVisibility = 0
view.Background = [1.0, 1.0, 1.0]
view.InteractionMode = "2D"

blocks = PVDReader(FileName=str(folder / "blocks.pvd"))
moved = WarpByVector(Input=blocks, Vectors=["POINTS", "collapse_mode"], ScaleFactor=1.0)
shown = Show(moved, view)
ColorBy(shown, ("CELLS", "principal_2"))
shown.RescaleTransferFunctionToDataRange(True, False)
bar = GetScalarBar(GetColorTransferFunction("principal_2"), view)
bar.Title, bar.ComponentTitle = "larger compressive principal stress (Pa)", ""
bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]
shown.SetScalarBarVisibility(view, True)

joints = XMLUnstructuredGridReader(FileName=[str(folder / "joints.vtu")])
lines = Show(WarpByVector(Input=joints, Vectors=["POINTS", "collapse_mode"], ScaleFactor=1.0), view)
ColorBy(lines, ("CELLS", "state"))
lines.LineWidth = 3.0

ResetCamera(view)
Render(view)
SaveScreenshot(str(picture), view)
print(f"picture: {picture}")
