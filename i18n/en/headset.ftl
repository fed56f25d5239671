### Messages for headsets (www/headset/). The page loads them only where the browser has one.

headsetEnter = View in VR
headsetLeave = Exit VR
headsetLoading = Loading VR…
headsetInside = The headset shows the model.
headsetEnded = VR has ended.
headsetFailed = VR could not be started: { $why }
headsetNoWebgl = this browser cannot draw for headsets (WebGL 2).
headsetLost = VR has ended because the graphics device was reset. You can start it again.
headsetClosed = VR has ended because the model was closed.
headsetWalk = Left thumbstick: walk
headsetTurn = Right thumbstick, left or right: turn
headsetJump = Right thumbstick, forward: aim, then release to teleport
headsetMeasure = Trigger: pick two points to measure a distance
headsetBack = Grip: cancel the point, or delete the last measurement
headsetHelp = X or A: show or hide this help
headsetMissed = There is no surface there.
