### Messages for the photographs that a model was coloured from (www/photographs/). The page loads them only if a version has a colour report.

photographs = Fotografias
photographsShow = Mostrar de onde as fotografias foram tiradas
photographsCount = { $count ->
        [one] { $count } fotografia. Clique na câmara ou na imagem para ver o modelo a partir dali.
        [many] { $count } de fotografias. Clique numa câmara ou numa imagem para ver o modelo a partir dali.
       *[other] { $count } fotografias. Clique numa câmara ou numa imagem para ver o modelo a partir dali.
    }
photographsFailed = Não foi possível ler a lista de fotografias: { $why }
photographsForm = não é um relatório de cores que o Kilwa consiga ler
photographBlend = Opacidade da fotografia
photographPrevious = Fotografia anterior
photographNext = Fotografia seguinte
photographWhole = Resolução máxima ({ $size })
photographFile = Abrir o ficheiro da fotografia
photographLoading = A carregar a fotografia…
photographHelp = Arraste para olhar em volta. O zoom altera o ângulo de visão.
photographNone = A fotografia não foi publicada. Este é o modelo visto de onde ela foi tirada.
photographFailed = Não foi possível carregar a fotografia: { $why }
photographBroken = Não foi possível carregar a fotografia.
photographNoWebgl = Este navegador não a consegue desenhar (WebGL 2).
