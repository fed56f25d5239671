### Messages for the photographs that a model was coloured from (www/photographs/). The page loads them only if a version has a colour report.

photographs = الصور الفوتوغرافية
photographsShow = إظهار أماكن التقاط الصور
photographsCount = { $count ->
        [zero] لا توجد صور.
        [one] صورة واحدة. انقر على الكاميرا أو على الصورة لرؤية النموذج من ذلك المكان.
        [two] صورتان. انقر على كاميرا أو على صورة لرؤية النموذج من ذلك المكان.
        [few] { $count } صور. انقر على كاميرا أو على صورة لرؤية النموذج من ذلك المكان.
        [many] { $count } صورة. انقر على كاميرا أو على صورة لرؤية النموذج من ذلك المكان.
       *[other] { $count } صورة. انقر على كاميرا أو على صورة لرؤية النموذج من ذلك المكان.
    }
photographsFailed = تعذّرت قراءة قائمة الصور: { $why }
photographsForm = هذا ليس تقرير ألوان يستطيع Kilwa قراءته
photographBlend = عتامة الصورة
photographPrevious = الصورة السابقة
photographNext = الصورة التالية
photographWhole = الدقة الكاملة ({ $size })
photographFile = فتح ملف الصورة
photographLoading = جارٍ تحميل الصورة…
photographHelp = اسحب للنظر حولك. التكبير والتصغير يغيّران زاوية الرؤية.
photographNone = لم تُنشر الصورة نفسها. هذا هو النموذج كما يُرى من مكان التقاطها.
photographFailed = تعذّر تحميل الصورة: { $why }
photographBroken = تعذّر تحميل الصورة.
photographNoWebgl = لا يستطيع هذا المتصفح رسمها (WebGL 2).
