### Messages of the portal: the server's own pages. They are put into HTML as they are, so that they hold no <, & or double quotes.

dir = ltr
name = Français
title = Modèles
search = Rechercher
searchLabel = Rechercher des modèles
sort = Ordre
relevance = Pertinence
byTitle = Titre
newest = Récents
largest = Grands d’abord
apply = Afficher
clear = Tout effacer
filters = Filtres
results = Modèles trouvés : { $count }
none = Aucun résultat.
noneNext = Essayez moins de mots ou moins de filtres, ou voyez tous les modèles.
all = Tous les modèles
page = Page { $page } sur { $pages }
previous = Précédente
next = Suivante
pages = Pages
country = Pays
kind = Genre
period = Période
licence = Licence
size = Taille
subject = Sujet
size-under-1m = moins d’un million de triangles
size-1m-10m = 1 à 10 millions
size-10m-100m = 10 à 100 millions
size-over-100m = plus de 100 millions
points = Points
triangles = Triangles
file = Fichier
embargo = Public à partir du { $day }
restricted = Non public
feed = Nouveaux modèles (flux)
packs = Paquets
language = Langue
failed = La recherche n’est pas disponible pour le moment.
failedNext = Les modèles restent visibles : toutes les adresses fonctionnent. Réessayez dans une minute.
remove = enlever
chosen = Choisi
version = Version { $number } du { $day }
signIn = Se connecter
signOut = Se déconnecter
userName = Nom d’utilisateur
password = Mot de passe
signInWrong = Le nom ou le mot de passe n’est pas juste.
signInWait = Il y a eu trop d’essais. Réessayez dans { $seconds ->
        [one] { $seconds } seconde
        [many] { $seconds } de secondes
       *[other] { $seconds } secondes
    }.
signedIn = Vous êtes connecté comme { $name }.
goOn = Continuer
bytes = { $count ->
        [one] { $count } octet
        [many] { $count } d’octets
       *[other] { $count } octets
    }
kB = ko
MB = Mo
GB = Go
extent = Étendue
spacing = Pas le plus fin
reference = Système de référence
local = local
notStated = non indiquée
broken = Ce fichier ne peut pas être affiché.
withdrawn = Retiré.
download = Télécharger le paquet
empty = Il n’y a pas encore de modèle ici.
emptyNext = Créez un paquet avec kilwa build, placez-le dans ce dossier et rechargez cette page.
map = Carte
mapCount = Modèles sur la carte : { $count }
mapNone = Aucun de ces modèles n’a de lieu public.
mapSource = Contour des terres : Natural Earth, approximatif.
mapWhole = Toute la carte
mapCloser = Modèles ici : { $count }. Agrandir
mapMore = Les { $count } premiers sont listés ; agrandissez pour voir les autres.
places = Lieux
list = Liste
collections = Collections
members = Modèles : { $count }
collectionFeed = Cette collection en flux
noCollections = Il n’y a pas encore de collection.
extractTitle = Téléchargements
extractLead = Le maillage pour d’autres programmes, sans fissures, à la taille voulue. Il est préparé à la demande.
extractFormat = Format
extractSize = Taille
extractWhole = Entier
extractTriangles = Au plus tant de triangles
extractError = À tant de mètres de la surface au plus
extractMake = Préparer le fichier
extractBack = Retour au modèle
extractQueued = Votre fichier attend son tour : { $count } avant lui.
extractRunning = Votre fichier est en préparation : { $percent } %.
extractWait = Cette page se rafraîchit d’elle-même. Vous pouvez la fermer et revenir à son adresse.
extractReady = Le fichier est prêt. Le téléchargement commence de lui-même.
extractFailed = Le fichier n’a pas pu être préparé.
extractFull = Le disque du serveur est plein. Son responsable doit faire de la place ; réessayez plus tard.
extractFetched = Obtenu du stockage de l’archive jusqu’ici : { $size }.
extractHalted = Le stockage de l’archive ne répond pas pour le moment. La préparation reprendra dès qu’il répondra ; cette page se met à jour d’elle-même.
extractAway = Le stockage de l’archive ne répond pas, ou ne donne pas le modèle pour le moment ; redemandez dans une minute.
extractBusy = Trop de fichiers sont en préparation. Réessayez dans { $seconds ->
        [one] { $seconds } seconde
        [many] { $seconds } de secondes
       *[other] { $seconds } secondes
    }.
extractTooLarge = Cela ferait environ { $size }, et ce serveur garde des fichiers jusqu’à { $most }. Demandez moins de triangles, ou téléchargez le paquet.
extractWrong = Ce n’est pas une taille : un nombre entier de triangles à partir de 1, ou des mètres comme 0.01.
extractUnknown = Rien n’est en préparation à cette adresse. Demandez le fichier à nouveau.
extractPack = Tel que publié
preview = Aperçu
plyWhat = couleurs, tous les attributs ; pour les logiciels de nuages de points et de maillages
glbWhat = couleurs ; pour le web, Blender, présentations
objWhat = texte, couleurs ; s’ouvre presque partout
stlWhat = la forme seule ; pour l’impression 3D
parts = Cette archive
signOutEverywhere = Se déconnecter partout
signInFailed = Le serveur ne peut connecter personne pour le moment. Réessayez dans une minute.
tooLong = Cette adresse est trop longue.
tooLongNext = Choisissez moins de filtres, ou cherchez avec moins de mots.
tooMany = On peut choisir au plus { $count } valeurs d’un même filtre : { $filter }.
tooManyNext = Continuer avec les { $count } premières
extractTime = Temps restant estimé : { $from } à { $to } min.
extractTimeShort = Temps restant estimé : moins de 1 min.
extractTimeUnknown = La durée ne peut pas encore être estimée.
extractShare = Votre réseau a déjà { $count ->
        [one] { $count } fichier
        [many] { $count } de fichiers
       *[other] { $count } fichiers
    } dans la file, le maximum pour un réseau. Réessayez dans { $seconds ->
        [one] { $seconds } seconde
        [many] { $seconds } de secondes
       *[other] { $seconds } secondes
    }.
extractTooMany = Votre réseau a demandé { $count ->
        [one] { $count } nouveau fichier
        [many] { $count } de nouveaux fichiers
       *[other] { $count } nouveaux fichiers
    } ces dix dernières minutes, le maximum pour un réseau. Réessayez dans { $seconds ->
        [one] { $seconds } seconde
        [many] { $seconds } de secondes
       *[other] { $seconds } secondes
    }.
months = janvier février mars avril mai juin juillet août septembre octobre novembre décembre
dateDay = { $day } { $month } { $year }
dateMonth = { $month } { $year }
survey = Levé
surveyStations = { $count ->
        [one] { $count } station
        [many] { $count } de stations
       *[other] { $count } stations
    }
surveySamples = { $count ->
        [one] { $count } point
        [many] { $count } de points
       *[other] { $count } points
    }
surveyEmpty = Ce levé n’a pas encore de station. Importez des scans avec kilwa scans import, puis rechargez cette page.
surveyPlan = Plan
surveyPlanWhat = Les points de toutes les stations vus d’en haut : plus il y a de surface au-dessus d’un endroit, plus le trait est marqué. La ligne à une station est l’axe x de son scanner.
surveyPlanNone = La pose d’aucune station n’est connue ; il n’y a donc pas de plan.
surveyPoseUnknown = Pose inconnue
surveyUnknownNext = Ces stations ne sont pas sur le plan. Recalez-les avec kilwa register, ou indiquez leurs poses dans survey.toml.
surveySame = { $count ->
        [one] { $count } station a
        [many] { $count } de stations ont
       *[other] { $count } stations ont
    } exactement la même pose qu’une autre. Si ces scans ne sont pas recalés, leurs poses ne sont pas encore connues : utilisez kilwa register, ou indiquez-les dans survey.toml.
surveyList = Stations
surveyStation = Station
surveySource = Fichier source
surveyNumber = Scan dans ce fichier
surveyScan = scan { $number }
surveyGrid = Grille
surveyGridNone = aucune (nuage de points)
surveySamplesHead = Points
surveyMasked = Masqués
surveyPosition = Position
surveyHeading = Orientation
surveyHeadingWhat = Orientation : direction de l’axe x du scanner, dans le sens horaire depuis l’axe y du levé.
surveyPose = Pose
surveyFixed = fixe
surveyPlacement = Placée par
surveyAnchor = ancrage
surveyByControl = points de contrôle
surveyBySurface = surface commune
surveyPoseChanged = pose modifiée depuis le recalage
surveySigma = Écart-type
surveySigmaWhat = Écart-type : d’une coordonnée de la station, et le plus grand d’une rotation, par rapport à l’ancrage ou aux stations fixes.
surveyLinks = Liaisons entre stations qui voient la même surface ; couleur et tirets : résidu ; trait fin : peu de points.
surveyReason = Raison :
surveyChain = Chaîne la plus faible :
surveyLinkList = Liaisons
surveyResidual = Résidu
surveyOverlap = Recouvrement
surveyContradicted = Contredits
surveyLinkWhat = Les plus grands résidus d’abord. Résidu : écart quadratique moyen entre les deux surfaces. Contredits : part des points que traversent des rayons de l’autre station. Écart-type : de la pose d’une station par rapport à l’autre, d’après cette seule liaison.
surveyRefused = Stations qui n’ont pas pu être placées
surveyRemedy = À faire :
surveyCandidate = Pose candidate d’une station non placée
surveyCandidates = Poses candidates, la meilleure d’abord
surveyCandidateOf = Pose candidate de { $name }, mise en correspondance avec { $other }
surveyMatched = Mise en correspondance avec
surveyAgreement = Concordance
surveyCandidateWhat = Recouvrement : part de la surface des deux stations que l’autre devrait voir aussi. Concordance : part de cette surface commune qui coïncide. Contredits : part que traversent des rayons de l’autre station.
surveyRefusedPicture = Image de distance de la station { $name }
surveyRegistrationBroken = registration.json ne peut pas être lu.
surveyInstrument = Instrument
surveyRange = Portée maximale
surveyBroken = Cette station ne peut pas être lue.
surveyControl = Point de contrôle
surveyPhotograph = Photographie
surveyAll = Plan et toutes les stations
surveyWrong = survey.toml contient des erreurs
surveyWrongNext = Corrigez-les, puis rechargez cette page.
surveyLost = Il n’y a rien à cette adresse
surveyLostNext = Le levé n’a pas de station de ce nom. Elle a peut-être été renommée ou supprimée.
controlTitle = Points de contrôle
controlMark = Marquer des points de contrôle
controlWhat = Si deux stations ont trop peu de surface en commun, ou si plusieurs poses conviennent, marquez au moins trois endroits que les deux voient. Elles pourront alors être recalées à partir de ces points.
controlA = Première station
controlB = Deuxième station
controlNone = Choisir une station
controlChoose = Afficher ces stations
controlSame = Choisissez deux stations différentes.
controlKinds = Images des deux stations
controlScripts = Pour marquer des points, il faut JavaScript, qui est désactivé dans ce navigateur.
controlHelp = Cliquez sur le même endroit dans les deux images, par exemple le coin d’une fenêtre ou d’une pierre. Agrandissez d’abord : plus l’image est agrandie, plus vous pouvez marquer avec précision. Choisissez des endroits éloignés les uns des autres et à des hauteurs différentes.
controlKeys = Au clavier : Tab mène à une image, + et − agrandissent et réduisent, les flèches déplacent l’image, Maj et les flèches déplacent la croix ; Entrée marque l’endroit sous la croix. Échap abandonne un endroit marqué dans une seule image, Ctrl+Z annule la dernière action.
controlFirst = Marquez un endroit dans une image, puis le même endroit dans l’autre.
controlOther = Marquez le même endroit dans { $name }.
controlNeed = { $count ->
        [one] Il manque encore { $count } paire.
        [many] Il manque encore { $count } de paires.
       *[other] Il manque encore { $count } paires.
    }
controlLine = Les points sont sur une même droite. Ajoutez-en un à l’écart de celle-ci.
controlPair = Paire { $number }
controlCheck = { $point } ne concorde pas : résidu de { $length }. À vérifier.
controlCheckThree = Les trois paires ne concordent pas (résidu jusqu’à { $length }) : vérifiez-les, ou ajoutez-en une quatrième.
controlSuspect = à vérifier
controlFits = Les paires concordent ; le plus grand résidu est de { $length }. Des paires supplémentaires rendent la pose plus fiable.
controlReading = Lecture du point…
controlEmpty = Il n’y a pas de point mesuré à cet endroit : le scanner n’y a rien mesuré, ou un masque le cache. Marquez un autre endroit.
controlUnreachable = Le serveur ne répond pas. Vérifiez la connexion et rechargez cette page.
controlFailed = Le serveur signale : { $reason }
controlMany = On ne peut pas marquer plus de { $count } paires.
controlUndo = Annuler
controlPairs = Paires
controlName = Nom
controlIn = Dans { $name } (m)
controlRemove = Supprimer
controlRemoveName = Supprimer { $name }
controlKnown = dans survey.toml
controlEntries = Entrées pour survey.toml
controlNext = Ajoutez ce texte à la fin de survey.toml, puis lancez kilwa register sur le dossier du levé.
controlNextAgain = Ajoutez ce texte à la fin de survey.toml, puis lancez kilwa register avec --again sur le dossier du levé : sinon, les deux stations gardent la pose qu’elles ont.
controlNextFixed = Les deux stations ont fixed = true dans survey.toml : le recalage ne change donc pas leur pose. Retirez-le de la station qui peut bouger, ajoutez ce texte à la fin de survey.toml, puis lancez kilwa register avec --again sur le dossier du levé.
controlCopy = Copier
controlCopied = Copié.
controlCopyByHand = Le texte est sélectionné : copiez-le avec Ctrl+C.
controlDownload = Télécharger
north = N
zoom = Zoom
zoomIn = Agrandir
zoomOut = Réduire
zoomWhole = Tout afficher
zoomHelp = Zoom : molette, deux doigts ou touches + et − ; 0 affiche tout. Pour déplacer l’image, faites-la glisser ou utilisez les flèches.
showWhat = Images de cette station
showRange = Distance
showIntensity = Intensité
showColour = Couleur
showMask = Masques
altRange = Image de distance de la station { $name }, telle que le scanner a vu les alentours : de sombre, à { $near }, à clair, à { $far }.
altIntensity = Image d’intensité de la station { $name }, telle que le scanner a vu les alentours : de sombre, { $low }, à clair, { $high }.
altColour = Image en couleur de la station { $name }, telle que le scanner a vu les alentours.
altMask = Image de la station { $name } en gris, avec les points masqués dans les couleurs de leurs masques.
maskOff = désactivé
maskOutdated = créé avec d’autres poses
noReturn = Aucun retour
noData = Aucune donnée
featured = Modèles à la une
imprint = Mentions légales
contact = Contact
lostNext = Le modèle a peut-être été renommé ou retiré.
