### Messages of the portal: the server's own pages. They are put into HTML as they are, so that they hold no <, & or double quotes.

dir = rtl
name = العربية
title = النماذج
search = بحث
searchLabel = البحث في النماذج
sort = الترتيب
relevance = الأقرب
byTitle = العنوان
newest = الأحدث
largest = الأكبر
apply = عرض
clear = مسح الكل
filters = عوامل التصفية
results = النماذج الموجودة: { $count }
none = لا توجد نتائج.
noneNext = جرّب كلمات أو عوامل تصفية أقل، أو شاهد كل النماذج.
all = كل النماذج
page = صفحة { $page } من { $pages }
previous = السابقة
next = التالية
pages = الصفحات
country = البلد
kind = النوع
period = الحقبة
licence = الترخيص
size = الحجم
subject = الموضوع
size-under-1m = أقل من مليون مثلث
size-1m-10m = من مليون إلى 10 ملايين
size-10m-100m = من 10 إلى 100 مليون
size-over-100m = أكثر من 100 مليون
points = النقاط
triangles = المثلثات
file = الملف
embargo = متاح للعموم ابتداءً من { $day }
restricted = غير متاح للعموم
feed = النماذج الجديدة (خلاصة)
packs = الحزم
language = اللغة
failed = البحث غير متاح الآن.
failedNext = النماذج نفسها متاحة: كل العناوين تعمل. حاول بعد دقيقة.
remove = إزالة
chosen = المختار
version = الإصدار { $number } بتاريخ { $day }
signIn = تسجيل الدخول
signOut = تسجيل الخروج
userName = اسم المستخدم
password = كلمة المرور
signInWrong = الاسم أو كلمة المرور غير صحيحة.
signInWait = كانت المحاولات كثيرة. حاول مرة أخرى بعد { $seconds ->
        [zero] { $seconds } ثانية
        [one] ثانية واحدة
        [two] ثانيتين
        [few] { $seconds } ثوانٍ
        [many] { $seconds } ثانية
       *[other] { $seconds } ثانية
    }.
signedIn = سجّلت الدخول باسم { $name }.
goOn = متابعة
bytes = { $count ->
        [zero] { $count } بايت
        [one] بايت واحد
        [two] بايتان
        [few] { $count } بايتات
        [many] { $count } بايتًا
       *[other] { $count } بايت
    }
kB = ك.ب
MB = م.ب
GB = غ.ب
extent = الامتداد
spacing = أدق تباعد
reference = النظام المرجعي
local = محلي
notStated = غير مذكور
broken = لا يمكن عرض هذا الملف.
withdrawn = سُحب.
download = تنزيل الحزمة
empty = لا يوجد نموذج هنا بعد.
emptyNext = أنشئ حزمة بالأمر kilwa build وضعها في هذا المجلد ثم أعد تحميل الصفحة.
map = خريطة
mapCount = النماذج على الخريطة: { $count }
mapNone = لا يوجد لأي من هذه النماذج مكان معلن.
mapSource = حدود اليابسة: ناتشورال إيرث، تقريبية.
mapWhole = الخريطة كاملة
mapCloser = النماذج هنا: { $count }. تكبير
mapMore = أُدرج أول { $count }؛ كبّر لرؤية البقية.
places = الأماكن
list = قائمة
collections = المجموعات
members = النماذج: { $count }
collectionFeed = هذه المجموعة كتغذية
noCollections = لا توجد مجموعة بعد.
extractTitle = التنزيلات
extractLead = الشبكة لبرامج أخرى، دون شقوق، وبالحجم الذي تحتاجه. تُعدّ عند الطلب.
extractFormat = الصيغة
extractSize = الحجم
extractWhole = كاملة
extractTriangles = عدد المثلثات على الأكثر
extractError = ضمن هذا العدد من الأمتار من السطح
extractMake = إعداد الملف
extractBack = العودة إلى النموذج
extractQueued = ملفك ينتظر دوره: { $count } قبله.
extractRunning = يجري إعداد ملفك: { $percent } %.
extractWait = تتحدث هذه الصفحة تلقائيًا. يمكنك إغلاقها والعودة إلى عنوانها.
extractReady = الملف جاهز. يبدأ التنزيل تلقائيًا.
extractFailed = تعذّر إعداد الملف.
extractFull = قرص الخادم ممتلئ. على المسؤول إخلاء مساحة؛ حاول لاحقًا.
extractFetched = جُلب من مخزن الأرشيف حتى الآن: { $size }.
extractHalted = لا يستجيب مخزن الأرشيف حاليًا. يستمر إعداد ملفك حين يستجيب؛ تتحدّث هذه الصفحة من تلقاء نفسها.
extractAway = لا يستجيب مخزن الأرشيف أو لا يعطي النموذج حاليًا؛ اطلبه ثانيةً بعد دقيقة.
extractBusy = يجري إعداد ملفات كثيرة جدًا الآن. حاول مجددًا بعد { $seconds ->
        [zero] { $seconds } ثانية
        [one] ثانية واحدة
        [two] ثانيتين
        [few] { $seconds } ثوانٍ
        [many] { $seconds } ثانية
       *[other] { $seconds } ثانية
    }.
extractTooLarge = سيكون ذلك نحو { $size }، وهذا الخادم يحفظ ملفات حتى { $most }. اطلب مثلثات أقل أو نزّل الحزمة.
extractWrong = هذا ليس حجمًا: عدد صحيح من المثلثات من 1 فصاعدًا، أو أمتار مثل 0.01.
extractUnknown = لا يجري إعداد شيء في هذا العنوان. اطلب الملف مجددًا.
extractPack = كما نُشر
preview = معاينة
plyWhat = ألوان وكل الخصائص؛ لبرامج السحب النقطية والشبكات
glbWhat = ألوان؛ للويب وبلندر والعروض
objWhat = نص وألوان؛ تفتح في كل مكان تقريبًا
stlWhat = الشكل وحده؛ للطباعة ثلاثية الأبعاد
parts = هذا الأرشيف
signOutEverywhere = تسجيل الخروج من جميع الأجهزة
signInFailed = لا يستطيع الخادم تسجيل دخول أحد حاليًا. حاول مرة أخرى بعد دقيقة.
tooLong = هذا العنوان طويل جدًا.
tooLongNext = اختر عوامل تصفية أقل، أو ابحث بكلمات أقل.
tooMany = الحد الأقصى لعدد القيم المختارة من عامل تصفية واحد هو { $count }: { $filter }.
tooManyNext = المتابعة مع أول { $count }
extractTime = الوقت المتبقي المقدَّر: من { $from } إلى { $to } د.
extractTimeShort = الوقت المتبقي المقدَّر: أقل من دقيقة.
extractTimeUnknown = لا يمكن تقدير المدة بعد.
extractShare = لشبكتك { $count ->
        [zero] { $count } ملف
        [one] ملف واحد
        [two] ملفان
        [few] { $count } ملفات
        [many] { $count } ملفًا
       *[other] { $count } ملف
    } في قائمة الانتظار، وهو الحد الأقصى لشبكة واحدة. حاول مرة أخرى بعد { $seconds ->
        [zero] { $seconds } ثانية
        [one] ثانية واحدة
        [two] ثانيتين
        [few] { $seconds } ثوانٍ
        [many] { $seconds } ثانية
       *[other] { $seconds } ثانية
    }.
extractTooMany = عدد الملفات الجديدة التي طلبتها شبكتك في الدقائق العشر الأخيرة: { $count }، وهو الحد الأقصى لشبكة واحدة. حاول مرة أخرى بعد { $seconds ->
        [zero] { $seconds } ثانية
        [one] ثانية واحدة
        [two] ثانيتين
        [few] { $seconds } ثوانٍ
        [many] { $seconds } ثانية
       *[other] { $seconds } ثانية
    }.
months = يناير فبراير مارس أبريل مايو يونيو يوليو أغسطس سبتمبر أكتوبر نوفمبر ديسمبر
dateDay = { $day } { $month } { $year }
dateMonth = { $month } { $year }
survey = مسح
surveyStations = { $count ->
        [zero] { $count } محطة
        [one] محطة واحدة
        [two] محطتان
        [few] { $count } محطات
        [many] { $count } محطة
       *[other] { $count } محطة
    }
surveySamples = { $count ->
        [zero] { $count } نقطة
        [one] نقطة واحدة
        [two] نقطتان
        [few] { $count } نقاط
        [many] { $count } نقطة
       *[other] { $count } نقطة
    }
surveyEmpty = لا توجد محطات في هذا المسح بعد. استورد عمليات المسح باستخدام kilwa scans import ثم أعد تحميل هذه الصفحة.
surveyPlan = المخطط
surveyPlanWhat = نقاط جميع المحطات منظورة من الأعلى: كلما زادت الأسطح فوق مكان ما ازداد رسمه قوة. الخط عند المحطة هو المحور x لجهاز المسح.
surveyPlanNone = لا توجد محطة ذات وضعية معروفة، ولذلك لا يوجد مخطط.
surveyPoseUnknown = وضعية غير معروفة
surveyUnknownNext = هذه المحطات غير موجودة على المخطط. سجّلها باستخدام kilwa register، أو أدخل وضعياتها في survey.toml.
surveySame = { $count ->
        [zero] { $count } محطة
        [one] محطة واحدة
        [two] محطتان
        [few] { $count } محطات
        [many] { $count } محطة
       *[other] { $count } محطة
    } بالوضعية نفسها تمامًا لمحطة أخرى. إذا لم تُسجَّل عمليات المسح هذه بعضها إلى بعض فوضعياتها غير معروفة بعد: استخدم kilwa register، أو أدخلها في survey.toml.
surveyList = المحطات
surveyStation = المحطة
surveySource = الملف المصدر
surveyNumber = رقم المسح في هذا الملف
surveyScan = المسح { $number }
surveyGrid = الشبكة
surveyGridNone = لا توجد (سحابة نقاط)
surveySamplesHead = النقاط
surveyMasked = المحجوبة
surveyPosition = الموضع
surveyHeading = الاتجاه
surveyHeadingWhat = الاتجاه: اتجاه المحور x لجهاز المسح، مع عقارب الساعة بدءًا من المحور y للمسح.
surveyPose = الوضعية
surveyFixed = ثابتة
surveyPlacement = أساس الوضعية
surveyAnchor = محطة مرجعية
surveyByControl = نقاط ضبط
surveyBySurface = سطح مشترك
surveyPoseChanged = تغيرت الوضعية بعد التسجيل
surveySigma = الانحراف المعياري
surveySigmaWhat = الانحراف المعياري: لإحداثي من إحداثيات المحطة، وأكبر انحراف للدوران، نسبةً إلى المحطة المرجعية أو المحطات الثابتة.
surveyLinks = وصلات بين محطات ترى السطح نفسه؛ اللون والتقطيع: الباقي؛ الخط الرفيع: نقاط قليلة.
surveyReason = السبب:
surveyChain = أضعف سلسلة:
surveyLinkList = الوصلات
surveyResidual = الباقي
surveyOverlap = التداخل
surveyContradicted = المتناقضة
surveyLinkWhat = الأكبر باقيًا أولًا. الباقي: جذر متوسط مربعات المسافة بين السطحين. المتناقضة: نسبة النقاط التي تخترقها أشعة المحطة الأخرى. الانحراف المعياري: لوضعية إحدى المحطتين نسبةً إلى الأخرى، من هذه الوصلة وحدها.
surveyRefused = محطات تعذر تحديد مواضعها
surveyRemedy = ما يجب فعله:
surveyCandidate = وضعية محتملة لمحطة لم يُحدَّد موضعها
surveyCandidates = الوضعيات المحتملة، الأفضل أولًا
surveyCandidateOf = وضعية محتملة للمحطة { $name }، قورنت بالمحطة { $other }
surveyMatched = المحطة المقارَن بها
surveyAgreement = التوافق
surveyCandidateWhat = التداخل: نسبة سطح المحطتين الذي ينبغي أن تراه المحطة الأخرى أيضًا. التوافق: نسبة هذا السطح المشترك المتطابقة. المتناقضة: نسبته التي تخترقها أشعة المحطة الأخرى.
surveyRefusedPicture = صورة المدى للمحطة { $name }
surveyRegistrationBroken = تعذرت قراءة registration.json.
surveyInstrument = الجهاز
surveyRange = أبعد مدى
surveyBroken = تعذرت قراءة هذه المحطة.
surveyControl = نقطة ضبط
surveyPhotograph = صورة فوتوغرافية
surveyAll = المخطط وجميع المحطات
surveyWrong = في survey.toml أخطاء
surveyWrongNext = صححها ثم أعد تحميل هذه الصفحة.
surveyLost = لا يوجد شيء في هذا العنوان
surveyLostNext = لا توجد في المسح محطة بهذا الاسم. ربما أعيدت تسميتها أو أزيلت.
controlTitle = نقاط الضبط
controlMark = تعليم نقاط ضبط
controlWhat = إذا كان السطح المشترك بين محطتين قليلًا، أو كانتا تتطابقان بأكثر من وضعية، فعلّم ثلاثة مواضع على الأقل تراها كلتاهما. عندئذ يمكن تسجيلهما من هذه النقاط.
controlA = المحطة الأولى
controlB = المحطة الثانية
controlNone = اختر محطة
controlChoose = عرض هاتين المحطتين
controlSame = اختر محطتين مختلفتين.
controlKinds = صور المحطتين
controlScripts = يتطلب تعليم النقاط JavaScript، وهي معطّلة في هذا المتصفح.
controlHelp = انقر على الموضع نفسه في الصورتين، مثل زاوية نافذة أو حجر. كبّر أولًا: كلما زاد التكبير زادت الدقة. اختر مواضع متباعدة وعلى ارتفاعات مختلفة.
controlKeys = بلوحة المفاتيح: انتقل إلى صورة بالمفتاح Tab، وكبّر وصغّر بالمفتاحين + و −، وحرّك الصورة بمفاتيح الأسهم، والعلامة المتقاطعة بالمفتاح Shift مع مفاتيح الأسهم؛ والمفتاح Enter يعلّم الموضع تحتها. Escape يلغي موضعًا عُلِّم في صورة واحدة فقط، وCtrl+Z يتراجع عن آخر خطوة.
controlFirst = علّم موضعًا في إحدى الصورتين، ثم الموضع نفسه في الأخرى.
controlOther = علّم الموضع نفسه في { $name }.
controlNeed = { $count ->
        [zero] لا يلزم أي زوج آخر.
        [one] يلزم زوج واحد آخر.
        [two] يلزم زوجان آخران.
        [few] يلزم { $count } أزواج أخرى.
        [many] يلزم { $count } زوجًا آخر.
       *[other] يلزم { $count } زوج آخر.
    }
controlLine = النقاط على خط مستقيم واحد. أضف نقطة بعيدة عنه.
controlPair = الزوج { $number }
controlCheck = { $point } غير متوافق: الباقي { $length }. تحقق منه.
controlCheckThree = الأزواج الثلاثة غير متوافقة (باقٍ يصل إلى { $length }): تحقق منها، أو أضف زوجًا رابعًا.
controlSuspect = تحقق منه
controlFits = الأزواج متوافقة؛ أكبر باقٍ هو { $length }. المزيد من الأزواج يجعل الوضعية أوثق.
controlReading = تجري قراءة النقطة…
controlEmpty = لا توجد نقطة مقاسة في هذا الموضع: لم يقس الجهاز شيئًا هناك، أو يخفيها قناع. علّم موضعًا آخر.
controlUnreachable = الخادم لا يستجيب. تحقق من الاتصال ثم أعد تحميل هذه الصفحة.
controlFailed = أفاد الخادم: { $reason }
controlMany = لا يمكن تعليم أكثر من { $count } زوجًا.
controlUndo = تراجع
controlPairs = الأزواج
controlName = الاسم
controlIn = في { $name } (م)
controlRemove = إزالة
controlRemoveName = إزالة { $name }
controlKnown = في survey.toml
controlEntries = مدخلات لملف survey.toml
controlNext = أضف هذا النص إلى نهاية survey.toml، ثم شغّل kilwa register على مجلد المسح.
controlNextAgain = أضف هذا النص إلى نهاية survey.toml، ثم شغّل kilwa register مع --again على مجلد المسح: وإلا احتفظت المحطتان بوضعيتيهما.
controlNextFixed = للمحطتين كلتيهما fixed = true في survey.toml، لذلك لا يغيّر التسجيل وضعيتيهما. احذفه من المحطة التي يجوز تحريكها، وأضف هذا النص إلى نهاية survey.toml، ثم شغّل kilwa register مع --again على مجلد المسح.
controlCopy = نسخ
controlCopied = تم النسخ.
controlCopyByHand = النص محدد: انسخه بالمفتاحين Ctrl+C.
controlDownload = تنزيل
north = ش
zoom = التكبير
zoomIn = تكبير
zoomOut = تصغير
zoomWhole = عرض الكل
zoomHelp = كبّر بالعجلة أو بإصبعين أو بالمفتاحين + و −؛ والمفتاح 0 يعرض الكل. اسحب أو استخدم مفاتيح الأسهم للتحريك.
showWhat = صور هذه المحطة
showRange = المدى
showIntensity = الشدة
showColour = اللون
showMask = الأقنعة
altRange = صورة المدى للمحطة { $name } كما رأى جهاز المسح ما حوله: من الداكن عند { $near } إلى الفاتح عند { $far }.
altIntensity = صورة الشدة للمحطة { $name } كما رأى جهاز المسح ما حوله: من الداكن { $low } إلى الفاتح { $high }.
altColour = صورة ملونة للمحطة { $name } كما رأى جهاز المسح ما حوله.
altMask = صورة المحطة { $name } بالرمادي، مع النقاط المحجوبة بألوان أقنعتها.
maskOff = متوقف
maskOutdated = أُنشئ بوضعيات أخرى
noReturn = لا ارتداد
noData = لا بيانات
featured = نماذج مختارة
imprint = إشعار قانوني
contact = للتواصل
lostNext = ربما أعيدت تسمية النموذج أو أزيل.
