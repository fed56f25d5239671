### Messages for the list of holes (www/holes.js). The page loads them only if there is such a list.

holes = Matundu
holesShow = Onyesha kingo za matundu
holesCount = { $count ->
        [one] Tundu { $count }, jumla { $area }.
       *[other] Matundu { $count }, jumla { $area }.
    }
holesRest = Madogo yasiyoonyeshwa: { $count }.
holeUnseen = Halikuonekana na kituo chochote
holeFree = Lilionekana hadi ng’ambo (uwazi)
holeDropped = Lilipimwa, lakini likaachwa
holeNoReturn = Bila mrejesho
holeSize = { $area }, ukingo { $length }
holesFailed = Orodha ya matundu haikusomeka: { $why }
holesForm = si orodha ambayo kilwa merge --holes iliandika pamoja na modeli hii
