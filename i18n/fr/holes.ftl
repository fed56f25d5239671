### Messages for the list of holes (www/holes.js). The page loads them only if there is such a list.

holes = Trous
holesShow = Montrer les contours des trous
holesCount = { $count ->
        [one] { $count } trou, { $area } au total.
        [many] { $count } de trous, { $area } au total.
       *[other] { $count } trous, { $area } au total.
    }
holesRest = Plus petits, non montrés : { $count }.
holeUnseen = Vu d’aucune station
holeFree = Vu au travers (ouverture)
holeDropped = Mesuré, mais écarté
holeNoReturn = Sans retour
holeSize = { $area }, bord { $length }
holesFailed = La liste des trous n’a pas pu être lue : { $why }
holesForm = ce n’est pas la liste que kilwa merge --holes a écrite avec ce modèle
