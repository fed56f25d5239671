### Ujumbe wa vifaa vya uhalisia pepe (www/headset/). Ukurasa huupakia tu pale kivinjari kina kifaa hicho.

headsetEnter = Tazama kwa uhalisia pepe
headsetLeave = Ondoka kwenye uhalisia pepe
headsetLoading = Uhalisia pepe unapakiwa…
headsetInside = Miwani inaonyesha modeli.
headsetEnded = Uhalisia pepe umekwisha.
headsetFailed = Uhalisia pepe haukuweza kuanzishwa: { $why }
headsetNoWebgl = kivinjari hiki hakiwezi kuchora kwa miwani ya uhalisia pepe (WebGL 2).
headsetLost = Uhalisia pepe umekwisha kwa sababu kifaa cha michoro kiliwekwa upya. Unaweza kuuanzisha tena.
headsetClosed = Uhalisia pepe umekwisha kwa sababu modeli ilifungwa.
headsetWalk = Kijiti cha kushoto: tembea
headsetTurn = Kijiti cha kulia, kushoto au kulia: geuka
headsetJump = Kijiti cha kulia, mbele: lenga, kisha achilia ili kuhamia hapo
headsetMeasure = Kifyatulio: chagua nukta mbili ili kupima umbali
headsetBack = Kitufe cha kushika: ghairi nukta, au futa kipimo cha mwisho
headsetHelp = X au A: onyesha au ficha msaada huu
headsetMissed = Hakuna uso mahali hapo.
