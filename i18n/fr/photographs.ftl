### Messages for the photographs that a model was coloured from (www/photographs/). The page loads them only if a version has a colour report.

photographs = Photographies
photographsShow = Afficher les lieux de prise de vue
photographsCount = { $count ->
        [one] { $count } photographie. Cliquez sur son appareil ou son image pour voir le modèle depuis cet endroit.
        [many] { $count } de photographies. Cliquez sur un appareil ou une image pour voir le modèle depuis cet endroit.
       *[other] { $count } photographies. Cliquez sur un appareil ou une image pour voir le modèle depuis cet endroit.
    }
photographsFailed = La liste des photographies n’a pas pu être lue : { $why }
photographsForm = ce n’est pas un rapport de couleurs que Kilwa sait lire
photographBlend = Opacité de la photographie
photographPrevious = Photographie précédente
photographNext = Photographie suivante
photographWhole = Pleine résolution ({ $size })
photographFile = Ouvrir le fichier de la photographie
photographLoading = Chargement de la photographie…
photographHelp = Faites glisser pour regarder autour de vous. Le zoom change l’angle de vue.
photographNone = La photographie elle-même n’a pas été publiée. Voici le modèle vu depuis le lieu de prise de vue.
photographFailed = La photographie n’a pas pu être chargée : { $why }
photographBroken = La photographie n’a pas pu être chargée.
photographNoWebgl = Ce navigateur ne peut pas la dessiner (WebGL 2).
