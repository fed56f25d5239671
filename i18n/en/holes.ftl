### Messages for the list of holes (www/holes.js). The page loads them only if there is such a list.

holes = Holes
holesShow = Show the holes as outlines
holesCount = { $count ->
        [one] { $count } hole, { $area } in total.
       *[other] { $count } holes, { $area } in total.
    }
holesRest = Smaller holes not shown: { $count }.
holeUnseen = Seen by no station
holeFree = Seen through (an opening)
holeDropped = Measured, but dropped
holeNoReturn = No return
holeSize = { $area }, rim { $length }
holesFailed = The list of holes could not be read: { $why }
holesForm = it is not the list that kilwa merge --holes wrote with this model
