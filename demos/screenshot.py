"""A screenshot of a result by ParaView: `pvpython demos/screenshot.py FOLDER [PICTURE.png]`.

The blocks move by the collapse mode, which is written so that a warp by 1 shows it, and have the
colour of the larger compressive principal stress. The joints move with them. FOLDER is what
`fenics-contact solve` wrote. ParaView needs a display; without one: `xvfb-run pvpython ...`.
"""

import sys
from pathlib import Path

import numpy as np
from paraview.servermanager import Fetch
from paraview.simple import (
    ColorBy,
    GetActiveViewOrCreate,
    GetColorTransferFunction,
    GetScalarBar,
    PVDReader,
    ResetCamera,
    SaveScreenshot,
    Show,
    WarpByVector,
    XMLUnstructuredGridReader,
)
from paraview.vtk.numpy_interface import dataset_adapter

if len(sys.argv) < 2:
    sys.exit("give the folder of a result: pvpython demos/screenshot.py demos/output/w3")
folder = Path(sys.argv[1]).resolve()
picture = Path(sys.argv[2] if len(sys.argv) > 2 else folder / "paraview.png").resolve()

view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [1200, 1200]
view.OrientationAxesVisibility = 0
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
view.InteractionMode = "2D"


def show(source, array, title, place):
    """Show a source, moved by the collapse mode, in the colours of an array by cell."""
    moved = WarpByVector(Input=source, Vectors=["POINTS", "collapse_mode"], ScaleFactor=1.0)
    shown = Show(moved, view)
    shown.Ambient, shown.Diffuse = 1.0, 0.0  # colours as in the bar, without a light
    ColorBy(shown, ("CELLS", array))
    colours = GetColorTransferFunction(array)
    bar = GetScalarBar(colours, view)
    bar.Title, bar.ComponentTitle = title, ""
    bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]
    bar.Orientation, bar.WindowLocation = "Horizontal", place
    bar.ScalarBarLength, bar.AddRangeLabels = 0.5, 0
    shown.SetScalarBarVisibility(view, True)
    return shown, colours


blocks = PVDReader(FileName=str(folder / "blocks.pvd"))
name = "larger compressive principal stress (Pa)"
_, colours = show(blocks, "principal_2", name, "Lower Center")
stress = np.ravel(dataset_adapter.WrapDataObject(Fetch(blocks)).CellData["principal_2"])
largest = np.quantile(-stress, 0.98)  # stresses at hinges depend on the mesh
colours.ColorSpace = "RGB"
colours.RGBPoints = [
    -largest,
    0.15,
    0.38,
    0.6,
    -0.5 * largest,
    0.56,
    0.73,
    0.86,
    0.0,
    0.93,
    0.93,
    0.9,
]

joints = XMLUnstructuredGridReader(FileName=[str(folder / "joints.vtu")])
lines, states = show(joints, "state", "joints", "Upper Center")
lines.LineWidth = 4.0
states.InterpretValuesAsCategories = 1
states.Annotations = ["0", "open", "1", "slip", "2", "stick"]
states.IndexedColors = [0.9, 0.62, 0.0, 0.0, 0.45, 0.7, 0.0, 0.0, 0.0]

ResetCamera(view)
SaveScreenshot(str(picture), view)
print(f"picture: {picture}")
