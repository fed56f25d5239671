### Messages for the photographs that a model was coloured from (www/photographs/). The page loads them only if a version has a colour report.

photographs = Picha
photographsShow = Onyesha mahali picha zilipopigwa
photographsCount = { $count ->
        [one] Picha { $count }. Bofya kamera au picha yake uone modeli kutoka hapo.
       *[other] Picha { $count }. Bofya kamera au picha uone modeli kutoka hapo.
    }
photographsFailed = Orodha ya picha haikuweza kusomwa: { $why }
photographsForm = hii si ripoti ya rangi ambayo Kilwa inaweza kuisoma
photographBlend = Uwazi wa picha
photographPrevious = Picha iliyotangulia
photographNext = Picha inayofuata
photographWhole = Ukubwa kamili ({ $size })
photographFile = Fungua faili ya picha
photographLoading = Picha inapakiwa…
photographHelp = Buruta kutazama pande zote. Kukuza hubadilisha pembe ya kutazama.
photographNone = Picha yenyewe haikuchapishwa. Hii ni modeli kutoka mahali ilipopigwa.
photographFailed = Picha haikuweza kupakiwa: { $why }
photographBroken = Picha haikuweza kupakiwa.
photographNoWebgl = Kivinjari hiki hakiwezi kuichora (WebGL 2).
