### Messages of the portal: the server's own pages. They are put into HTML as they are, so that they hold no <, & or double quotes.

dir = ltr
name = Português
title = Modelos
search = Pesquisar
searchLabel = Pesquisar modelos
sort = Ordem
relevance = Relevância
byTitle = Título
newest = Mais recentes
largest = Maiores
apply = Mostrar
clear = Limpar tudo
filters = Filtros
results = Modelos encontrados: { $count }
none = Nada encontrado.
noneNext = Tente menos palavras ou menos filtros, ou veja todos os modelos.
all = Todos os modelos
page = Página { $page } de { $pages }
previous = Anterior
next = Seguinte
pages = Páginas
country = País
kind = Género
period = Período
licence = Licença
size = Tamanho
subject = Assunto
size-under-1m = menos de 1 milhão de triângulos
size-1m-10m = 1 a 10 milhões
size-10m-100m = 10 a 100 milhões
size-over-100m = mais de 100 milhões
points = Pontos
triangles = Triângulos
file = Ficheiro
embargo = Público a partir de { $day }
restricted = Não público
feed = Novos modelos (feed)
packs = Pacotes
language = Língua
failed = De momento não é possível pesquisar.
failedNext = Os modelos continuam visíveis: todos os endereços funcionam. Tente de novo dentro de um minuto.
remove = retirar
chosen = Escolhido
version = Versão { $number } de { $day }
signIn = Entrar
signOut = Sair
userName = Nome de utilizador
password = Palavra-passe
signInWrong = O nome ou a palavra-passe não está certo.
signInWait = Houve demasiadas tentativas. Tente de novo dentro de { $seconds ->
        [one] { $seconds } segundo
        [many] { $seconds } de segundos
       *[other] { $seconds } segundos
    }.
signedIn = Entrou como { $name }.
goOn = Continuar
bytes = { $count ->
        [one] { $count } byte
        [many] { $count } de bytes
       *[other] { $count } bytes
    }
kB = kB
MB = MB
GB = GB
extent = Extensão
spacing = Espaçamento mais fino
reference = Sistema de referência
local = local
notStated = não indicada
broken = Este ficheiro não pode ser mostrado.
withdrawn = Retirado.
download = Transferir o pacote
empty = Ainda não há nenhum modelo aqui.
emptyNext = Crie um pacote com kilwa build, coloque-o nesta pasta e recarregue esta página.
map = Mapa
mapCount = Modelos no mapa: { $count }
mapNone = Nenhum destes modelos tem um local público.
mapSource = Contorno da terra: Natural Earth, aproximado.
mapWhole = O mapa inteiro
mapCloser = Modelos aqui: { $count }. Aproximar
mapMore = Os primeiros { $count } estão listados; aproxime para ver os outros.
places = Locais
list = Lista
collections = Coleções
members = Modelos: { $count }
collectionFeed = Esta coleção como feed
noCollections = Ainda não há nenhuma coleção.
extractTitle = Transferências
extractLead = A malha para outros programas, sem fendas, no tamanho de que precisa. É preparada a pedido.
extractFormat = Formato
extractSize = Tamanho
extractWhole = Inteiro
extractTriangles = No máximo tantos triângulos
extractError = A tantos metros da superfície no máximo
extractMake = Preparar o ficheiro
extractBack = Voltar ao modelo
extractQueued = O seu ficheiro aguarda a vez: { $count } antes dele.
extractRunning = O seu ficheiro está a ser preparado: { $percent } %.
extractWait = Esta página atualiza-se sozinha. Pode fechá-la e voltar ao seu endereço.
extractReady = O ficheiro está pronto. A transferência começa sozinha.
extractFailed = O ficheiro não pôde ser preparado.
extractFull = O disco do servidor está cheio. O responsável tem de libertar espaço; tente mais tarde.
extractFetched = Obtido do armazenamento do arquivo até agora: { $size }.
extractHalted = O armazenamento do arquivo não responde de momento. A preparação continua quando responder; esta página atualiza-se sozinha.
extractAway = O armazenamento do arquivo não responde, ou não dá o modelo de momento; peça de novo daqui a um minuto.
extractBusy = Estão a ser preparados demasiados ficheiros. Tente de novo dentro de { $seconds ->
        [one] { $seconds } segundo
        [many] { $seconds } de segundos
       *[other] { $seconds } segundos
    }.
extractTooLarge = Seriam cerca de { $size }, e este servidor guarda ficheiros até { $most }. Peça menos triângulos, ou transfira o pacote.
extractWrong = Isso não é um tamanho: um número inteiro de triângulos a partir de 1, ou metros como 0.01.
extractUnknown = Nada está a ser preparado neste endereço. Peça o ficheiro de novo.
extractPack = Como foi publicado
preview = Pré-visualização
plyWhat = cores, todos os atributos; para programas de nuvens de pontos e malhas
glbWhat = cores; para a web, Blender, apresentações
objWhat = texto, cores; abre em quase todo o lado
stlWhat = só a forma; para impressão 3D
parts = Este arquivo
signOutEverywhere = Terminar todas as sessões
signInFailed = O servidor não pode iniciar sessões neste momento. Tente de novo daqui a um minuto.
tooLong = Este endereço é demasiado longo.
tooLongNext = Escolha menos filtros, ou pesquise com menos palavras.
tooMany = Podem escolher-se no máximo { $count } valores de um filtro: { $filter }.
tooManyNext = Continuar com os primeiros { $count }
extractTime = Tempo restante estimado: { $from } a { $to } min.
extractTimeShort = Tempo restante estimado: menos de 1 min.
extractTimeUnknown = Ainda não é possível estimar a duração.
extractShare = A sua rede já tem { $count ->
        [one] { $count } ficheiro
        [many] { $count } de ficheiros
       *[other] { $count } ficheiros
    } na fila, o máximo para uma rede. Tente de novo daqui a { $seconds ->
        [one] { $seconds } segundo
        [many] { $seconds } de segundos
       *[other] { $seconds } segundos
    }.
extractTooMany = A sua rede pediu { $count ->
        [one] { $count } ficheiro novo
        [many] { $count } de ficheiros novos
       *[other] { $count } ficheiros novos
    } nos últimos dez minutos, o máximo para uma rede. Tente de novo daqui a { $seconds ->
        [one] { $seconds } segundo
        [many] { $seconds } de segundos
       *[other] { $seconds } segundos
    }.
months = janeiro fevereiro março abril maio junho julho agosto setembro outubro novembro dezembro
dateDay = { $day } de { $month } de { $year }
dateMonth = { $month } de { $year }
survey = Levantamento
surveyStations = { $count ->
        [one] { $count } estação
        [many] { $count } de estações
       *[other] { $count } estações
    }
surveySamples = { $count ->
        [one] { $count } ponto
        [many] { $count } de pontos
       *[other] { $count } pontos
    }
surveyEmpty = Este levantamento ainda não tem estações. Importe varrimentos com kilwa scans import e recarregue esta página.
surveyPlan = Planta
surveyPlanWhat = Os pontos de todas as estações vistos de cima: quanto mais superfície há sobre um lugar, mais marcado é o traço. A linha numa estação é o eixo x do seu scanner.
surveyPlanNone = Nenhuma estação tem pose conhecida; por isso não há planta.
surveyPoseUnknown = Pose desconhecida
surveyUnknownNext = Estas estações não estão na planta. Registe-as com kilwa register, ou indique as suas poses em survey.toml.
surveySame = { $count ->
        [one] { $count } estação tem
        [many] { $count } de estações têm
       *[other] { $count } estações têm
    } exatamente a mesma pose que outra. Se estes varrimentos não estão registados, as suas poses ainda não são conhecidas: utilize kilwa register, ou indique-as em survey.toml.
surveyList = Estações
surveyStation = Estação
surveySource = Ficheiro de origem
surveyNumber = Varrimento neste ficheiro
surveyScan = varrimento { $number }
surveyGrid = Grelha
surveyGridNone = nenhuma (nuvem de pontos)
surveySamplesHead = Pontos
surveyMasked = Mascarados
surveyPosition = Posição
surveyHeading = Orientação
surveyHeadingWhat = Orientação: direção do eixo x do scanner, no sentido horário a partir do eixo y do levantamento.
surveyPose = Pose
surveyFixed = fixa
surveyPlacement = Colocada por
surveyAnchor = âncora
surveyByControl = pontos de controlo
surveyBySurface = superfície comum
surveyPoseChanged = pose alterada depois do registo dos varrimentos
surveySigma = Desvio padrão
surveySigmaWhat = Desvio padrão: de uma coordenada da estação, e o maior de uma rotação, em relação à âncora ou às estações fixas.
surveyLinks = Ligações entre estações que veem a mesma superfície; cor e tracejado: resíduo; traço fino: poucos pontos.
surveyReason = Motivo:
surveyChain = Cadeia mais fraca:
surveyLinkList = Ligações
surveyResidual = Resíduo
surveyOverlap = Sobreposição
surveyContradicted = Contrariados
surveyLinkWhat = Os maiores resíduos primeiro. Resíduo: valor quadrático médio da distância entre as duas superfícies. Contrariados: parte dos pontos que raios da outra estação atravessam. Desvio padrão: da pose de uma estação em relação à outra, apenas a partir desta ligação.
surveyRefused = Estações que não foi possível colocar
surveyRemedy = O que fazer:
surveyCandidate = Pose candidata de uma estação não colocada
surveyCandidates = Poses candidatas, da melhor para a pior
surveyCandidateOf = Pose candidata de { $name }, em correspondência com { $other }
surveyMatched = Em correspondência com
surveyAgreement = Concordância
surveyCandidateWhat = Sobreposição: proporção da superfície das duas estações que a outra também deveria ver. Concordância: proporção desta superfície comum que coincide. Contrariados: proporção que raios da outra estação atravessam.
surveyRefusedPicture = Imagem de distância da estação { $name }
surveyRegistrationBroken = Não é possível ler registration.json.
surveyInstrument = Instrumento
surveyRange = Alcance máximo
surveyBroken = Não é possível ler esta estação.
surveyControl = Ponto de controlo
surveyPhotograph = Fotografia
surveyAll = Planta e todas as estações
surveyWrong = survey.toml tem erros
surveyWrongNext = Corrija-os e recarregue esta página.
surveyLost = Não há nada neste endereço
surveyLostNext = O levantamento não tem nenhuma estação com este nome. Pode ter mudado de nome ou sido removida.
controlTitle = Pontos de controlo
controlMark = Marcar pontos de controlo
controlWhat = Se duas estações têm pouca superfície em comum, ou se se ajustam em várias poses, marque pelo menos três lugares que ambas veem. Podem então ser registadas a partir destes pontos.
controlA = Primeira estação
controlB = Segunda estação
controlNone = Escolher uma estação
controlChoose = Mostrar estas estações
controlSame = Escolha duas estações diferentes.
controlKinds = Imagens das duas estações
controlScripts = Para marcar pontos é preciso JavaScript, que está desativado neste navegador.
controlHelp = Clique no mesmo lugar nas duas imagens, por exemplo no canto de uma janela ou de uma pedra. Amplie primeiro: quanto mais ampliada a imagem, com mais precisão pode marcar. Escolha lugares afastados uns dos outros e a alturas diferentes.
controlKeys = Com o teclado: Tab leva a uma imagem, + e − ampliam e reduzem, as setas movem a imagem, Shift e as setas movem a cruz; Enter marca o lugar sob a cruz. Escape descarta um lugar marcado só numa imagem, Ctrl+Z anula o último passo.
controlFirst = Marque um lugar numa imagem e depois o mesmo lugar na outra.
controlOther = Marque o mesmo lugar em { $name }.
controlNeed = { $count ->
        [one] Falta ainda { $count } par.
        [many] Faltam ainda { $count } de pares.
       *[other] Faltam ainda { $count } pares.
    }
controlLine = Os pontos estão numa linha reta. Acrescente um afastado dela.
controlPair = Par { $number }
controlCheck = { $point } não concorda: resíduo de { $length }. Verifique.
controlCheckThree = Os três pares não concordam entre si (resíduo até { $length }): verifique-os ou acrescente um quarto.
controlSuspect = verificar
controlFits = Os pares concordam; o maior resíduo é de { $length }. Mais pares tornam a pose mais fiável.
controlReading = A ler o ponto…
controlEmpty = Não há ponto medido neste lugar: o scanner não mediu nada ali, ou uma máscara esconde-o. Marque outro lugar.
controlUnreachable = O servidor não responde. Verifique a ligação e recarregue esta página.
controlFailed = O servidor indica: { $reason }
controlMany = Não se podem marcar mais de { $count } pares.
controlUndo = Anular
controlPairs = Pares
controlName = Nome
controlIn = Em { $name } (m)
controlRemove = Remover
controlRemoveName = Remover { $name }
controlKnown = em survey.toml
controlEntries = Entradas para survey.toml
controlNext = Acrescente este texto no fim de survey.toml e execute kilwa register na pasta do levantamento.
controlNextAgain = Acrescente este texto no fim de survey.toml e execute kilwa register com --again na pasta do levantamento: de outro modo, as duas estações mantêm a pose que têm.
controlNextFixed = As duas estações têm fixed = true em survey.toml, por isso o registo não altera as suas poses. Retire-o da estação que pode mover-se, acrescente este texto no fim de survey.toml e execute kilwa register com --again na pasta do levantamento.
controlCopy = Copiar
controlCopied = Copiado.
controlCopyByHand = O texto está selecionado: copie-o com Ctrl+C.
controlDownload = Descarregar
north = N
zoom = Zoom
zoomIn = Ampliar
zoomOut = Reduzir
zoomWhole = Mostrar tudo
zoomHelp = Zoom: roda do rato, dois dedos ou teclas + e −; 0 mostra tudo. Para mover, arraste ou use as teclas de seta.
showWhat = Imagens desta estação
showRange = Distância
showIntensity = Intensidade
showColour = Cor
showMask = Máscaras
altRange = Imagem de distância da estação { $name }, como o scanner viu o que o rodeia: de escuro, a { $near }, a claro, a { $far }.
altIntensity = Imagem de intensidade da estação { $name }, como o scanner viu o que o rodeia: de escuro, { $low }, a claro, { $high }.
altColour = Imagem a cores da estação { $name }, como o scanner viu o que o rodeia.
altMask = Imagem da estação { $name } em cinzento, com os pontos mascarados nas cores das suas máscaras.
maskOff = desativada
maskOutdated = feita com outras poses
noReturn = Sem retorno
noData = Sem dados
featured = Modelos em destaque
imprint = Aviso legal
contact = Contacto
lostNext = O modelo pode ter mudado de nome ou ter sido removido.
