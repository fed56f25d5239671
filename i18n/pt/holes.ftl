### Messages for the list of holes (www/holes.js). The page loads them only if there is such a list.

holes = Buracos
holesShow = Mostrar os contornos dos buracos
holesCount = { $count ->
        [one] { $count } buraco, { $area } no total.
        [many] { $count } de buracos, { $area } no total.
       *[other] { $count } buracos, { $area } no total.
    }
holesRest = Menores, não mostrados: { $count }.
holeUnseen = Não visto de nenhuma estação
holeFree = Visto através (abertura)
holeDropped = Medido, mas descartado
holeNoReturn = Sem retorno
holeSize = { $area }, bordo { $length }
holesFailed = A lista de buracos não pôde ser lida: { $why }
holesForm = não é a lista que kilwa merge --holes escreveu com este modelo
