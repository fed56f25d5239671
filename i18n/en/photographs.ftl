### Messages for the photographs that a model was coloured from (www/photographs/). The page loads them only if a version has a colour report.

photographs = Photographs
photographsShow = Show where the photographs were taken
photographsCount = { $count ->
        [one] { $count } photograph. Click its camera or its picture to see the model from there.
       *[other] { $count } photographs. Click a camera or a picture to see the model from there.
    }
photographsFailed = The list of photographs could not be read: { $why }
photographsForm = this is not a colour report that Kilwa can read
photographBlend = Photograph opacity
photographPrevious = Previous photograph
photographNext = Next photograph
photographWhole = Full resolution ({ $size })
photographFile = Open the photograph file
photographLoading = Loading the photograph…
photographHelp = Drag to look around. Zooming changes the angle of view.
photographNone = The photograph itself was not published. This is the model from where it was taken.
photographFailed = The photograph could not be loaded: { $why }
photographBroken = The photograph could not be loaded.
photographNoWebgl = This browser cannot draw it (WebGL 2).
