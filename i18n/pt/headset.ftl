### Mensagens para óculos de realidade virtual (www/headset/). A página só as carrega onde o navegador os tem.

headsetEnter = Ver em realidade virtual
headsetLeave = Sair da realidade virtual
headsetLoading = A carregar a realidade virtual…
headsetInside = Os óculos mostram o modelo.
headsetEnded = A realidade virtual terminou.
headsetFailed = Não foi possível iniciar a realidade virtual: { $why }
headsetNoWebgl = este navegador não consegue desenhar para óculos de realidade virtual (WebGL 2).
headsetLost = A realidade virtual terminou porque o dispositivo gráfico foi reiniciado. Pode iniciá-la de novo.
headsetClosed = A realidade virtual terminou porque o modelo foi fechado.
headsetWalk = Manípulo esquerdo: caminhar
headsetTurn = Manípulo direito, para os lados: rodar
headsetJump = Manípulo direito, para a frente: apontar e soltar para se teletransportar
headsetMeasure = Gatilho: escolher dois pontos para medir uma distância
headsetBack = Botão lateral: cancelar o ponto ou eliminar a última medição
headsetHelp = X ou A: mostrar ou ocultar esta ajuda
headsetMissed = Não há superfície nesse lugar.
