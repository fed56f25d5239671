### Messages of the page (www). Keys are named in its HTML and scripts; those of the measuring engine are its codes: refuse-few is refuseFew.

allModels = كل النماذج
share = مشاركة
picture = حفظ صورة
shared = نُسخ الرابط
shareFailed = تعذّر نسخ الرابط. تجده في شريط العنوان.
shareLink = رابط هذا المنظر
shareCode = شيفرة لصفحة ويب
shareCodeHelp = تعرض النموذج في صفحة أخرى، ويذكر الإطار عنوانه وصانعيه ورخصته.
shareQr = رمز QR للرابط
shareQrSave = حفظ بصيغة SVG
shareQrLong = الرابط أطول من أن يتسع له رمز QR.
shareLocal = هذا النموذج ملف على هذا الحاسوب، فلن يؤدي الرابط إلى شيء. انشره لتشاركه.
shareBroken = تعذر فتح النافذة: { $why }
copy = نسخ
copied = نُسخ
download = تنزيل الملف
fullscreen = ملء الشاشة
help = كيفية التجوّل
language = اللغة
panel = التفاصيل
panelSize = تكبير التفاصيل أو تصغيرها
panelWidth = عرض التفاصيل؛ تغيّره مفاتيح الأسهم
canvas = نموذج ثلاثي الأبعاد
canvasHelp = مفاتيح الأسهم تدير النموذج، وShift مع الأسهم يحرّكه، وزائد وناقص للتقريب، وF يُظهره كله، ومن 1 إلى 7 لاختيار مشهد، وW للسير، وM للقياس، وN لكتابة ملاحظة، وZ للعودة إلى المشهد السابق، وعلامة الاستفهام تفتح المساعدة.
tools = الأدوات
toolOrbit = السحب يدير النموذج
toolPan = السحب يحرّك النموذج
toolWalk = السير على مستوى العين
toolNote = كتابة ملاحظة على النموذج
hintWalk = المفاتيح W A S D أو الأسهم للسير · اسحب لتنظر حولك · انقر مرتين لتقف هناك · Esc للخروج
hintNote = انقر المكان على السطح · بالمفاتيح: الأسهم تحرّك العلامة والمسافة تختار · Esc للخروج
hintWalkTouch = اللوحة للسير · اسحب لتنظر حولك · المس مرتين لتقف هناك
hintNoteTouch = المس المكان على السطح
fit = عرض الكل
views = المناظر القياسية
zoomIn = تقريب
zoomOut = إبعاد
hide = إخفاء كل شيء ما عدا النموذج
showAgain = إظهار الأدوات
viewPlan = مسقط من الأعلى
viewNorth = من الشمال
viewEast = من الشرق
viewSouth = من الجنوب
viewWest = من الغرب
viewIso = منظر مائل
viewBelow = من الأسفل
cube = مكعّب المناظر
facePlan = أعلى
faceNorth = ش
faceEast = شق
faceSouth = ج
faceWest = غ
faceBelow = أسفل
walk = السير
walkForward = إلى الأمام
walkBack = إلى الخلف
walkLeft = إلى اليسار
walkRight = إلى اليمين
walkSides = إلى الجانبين
walkRun = أسرع
walkLeave = إنهاء السير
eyeLower = خفض العين
eyeHigher = رفع العين
eyeChange = خفض العين ورفعها
eyeHeight = العين على { $height }
loadingTitle = تحميل الصورة الأولى
loadingBytes = { $done } من { $total }
loadingProgram = تشغيل العارض
loadingDetail = تحميل التفاصيل
tryAgain = أعد المحاولة
noGpuTitle = لا يستطيع هذا المتصفح رسم النموذج
noGpuMissing = يرسم العارض بتقنية WebGPU أو WebGL 2. لا تتوفر أيٌّ منهما في هذا المتصفح أو هما معطّلتان. تتوفران في الإصدارات الحديثة من Chrome وEdge وFirefox وSafari.
noGpuAdapter = تقنية WebGPU موجودة لكنها لم تجد جهاز رسوميات صالحًا، ولم تعمل WebGL 2 كذلك. حدّث برنامج تشغيل الرسوميات أو جرّب متصفحًا أو حاسوبًا آخر.
noGpuInsecure = تقنية WebGL 2 غير متوفرة أو معطّلة هنا، ولا تتيح المتصفحات WebGPU إلا للصفحات ذات العنوان الآمن. افتح هذه الصفحة عبر https:// أو localhost.
missingTitle = النموذج غير موجود
missingText = لا يوجد ملف على الخادم بهذا العنوان. ربما أُعيدت تسميته أو أُزيل.
damagedTitle = الملف تالف
damagedText = ما أرسله الخادم ليس ملفًا كاملًا. يمكن لمن يحفظ الملف فحصه بالأمر kilwa verify ونسخه من جديد.
cutOffTitle = الملف غير مكتمل
cutOffNotice = الملف غير مكتمل: يوجد منه { $here } من أصل { $all }. يُعرض الناقص بتفاصيل أقل، ولا يمكن القياس. يستطيع مدير الموقع استعادة الملف من نسخة.
noRangeTitle = لا يستطيع هذا الخادم بثّ النموذج
noRangeText = يرسل الملف كله بحجم { $size } بدلًا من الأجزاء المطلوبة. قدّمه بالأمر kilwa serve أو بأي خادم يجيب عن طلبات النطاق.
noRangeSmall = لا يرسل هذا الخادم أجزاء من الملفات، لذلك يُحمَّل الملف كله بحجم { $size }.
noCorsTitle = لا يتيح الخادم النموذج لهذه الصفحة
noCorsText = يجيب { $host }، لكنه لا يسمح لصفحات المواقع الأخرى بقراءة ملفاته (CORS)، أو يرفض الطلبات حاليًا. إذا استمر ذلك، فعلى مشغّله أن يجعله يرسل ‎Access-Control-Allow-Origin‎؛ يشرح ذلك فصل «Hosting» في وثائق Kilwa. ويمكن فتح ملف مُنزَّل هنا.
closedTitle = هذا النموذج غير متاح للعموم
closedText = وصفه وصوره وطريقة الاستشهاد به في اللوحة، أما النموذج نفسه فلا يفتحه إلا من لهم حق الوصول.
signIn = تسجيل الدخول
changedTitle = استُبدل النموذج على الخادم
changedText = يوجد ملف أحدث منذ فتح هذه الصفحة. أعد تحميل الصفحة لرؤيته.
brokenTitle = توقّف العارض
brokenText = حدث خطأ غير متوقع. إعادة تحميل الصفحة تفيد عادةً.
gpuGoneTitle = جهاز الرسوميات يتعطل مرارًا
gpuGoneText = فقده المتصفح عدة مرات أثناء رسم هذا النموذج. أغلق الصفحات والبرامج الأخرى التي ترسم بالأبعاد الثلاثة ثم حاول مجددًا؛ المنظر والملاحظات والقياسات محفوظة.
openTitle = افتح نموذجًا
openText = اختر ملف ‎.kilwa من هذا الحاسوب، أو أفلته على الصفحة. لا يُرسل منه شيء.
openFile = فتح ملف…
dropHere = أفلت الملف لفتح النموذج
openWhole = فتح الصفحة كاملة
otherPack = أُنشئ هذا الرابط لنسخة أخرى من النموذج. قد لا يطابق المشهد.
otherFile = أُنشئ لإصدار آخر من النموذج؛ قد يقع ما يعرضه في مكان آخر هنا.
displayFailed = تعذّر تطبيق إعدادات العرض هذه: { $why }
annotationsFailed = تعذّرت قراءة الملاحظات المنشورة: { $why }
annotationsOrigin = يجب أن تأتي هذه الملفات من موقع الصفحة أو النموذج، لا من { $origin }
offlineFirst = لا يجيب الخادم. إعادة المحاولة بعد { $seconds } ث.
offline = غير متصل، إعادة المحاولة بعد { $seconds } ث
retrying = لم يصل جزء، إعادة المحاولة بعد { $seconds } ث
limited = { $seconds ->
        [zero] يطلب الخادم الانتظار؛ تُستأنف العملية الآن
        [one] يطلب الخادم الانتظار؛ تُستأنف العملية بعد ثانية واحدة
        [two] يطلب الخادم الانتظار؛ تُستأنف العملية بعد ثانيتين
        [few] يطلب الخادم الانتظار؛ تُستأنف العملية بعد { $seconds } ثوانٍ
        [many] يطلب الخادم الانتظار؛ تُستأنف العملية بعد { $seconds } ثانية
       *[other] يطلب الخادم الانتظار؛ تُستأنف العملية بعد { $seconds } ثانية
    }
damagedPart = يصل جزء من الملف تالفًا. يُعرض هناك بتفصيل أقل وتُعاد المحاولة.
gpuLost = أُعيد تشغيل جهاز الرسوميات. يُعاد بناء الصورة.
tabAbout = نبذة
tabViews = المشاهد
tabNotes = ملاحظات
tabDisplay = العرض
tabSection = القص
tabInfo = إحصاءات
shading = التظليل
modeColor = لون
modeClay = طين
modeNormals = الأعمدة
modeHeadlight = مصباح عند العين
modeRaking = إضاءة مائلة
modeCurvature = حواف وتجاويف
modeEyeDome = حواف العمق
modeHeight = الارتفاع
modeDistance = البعد عن مستوٍ
modeScalar = قيمة مقيسة
lightDisc = اتجاه الضوء؛ مفاتيح الأسهم تديره وترفعه
lightValue = السمت { $azimuth }°، الارتفاع { $elevation }°
azimuth = السمت، °
elevation = الارتفاع، °
lightWithView = ثابت في الصورة
onColour = على ألوان المسح
reliefShading = تظليل التضاريس
strength = الشدة
radius = نصف القطر
featureSize = حجم التفاصيل، م
legendLow = من
legendHigh = إلى
legendReset = المدى كله
channel = القيمة
plane = المستوى
planeLevel = أفقي
planeNorth = قائم، مواجه للشمال
planeEast = قائم، مواجه للشرق
planeView = مواجه للعرض
planePoints = عبر ثلاث نقاط…
planeOther = مائل
planeOffset = الإزاحة، م
hintPoints = اختر النقطة { $n } من ثلاث على السطح. Esc للإلغاء.
appearance = المظهر
markInside = تمييز الداخل
showFilled = إظهار السطح المملوء
fadeLevels = ظهور التفاصيل بتدرج
background = الخلفية
bgAuto = مثل الصفحة
bgLight = فاتحة
bgDark = داكنة
bgWhite = بيضاء
bgBlack = سوداء
bgTransparent = شفاف
clipPlane = مستوٍ
clipBox = صندوق
clipOn = القص هنا
clipAxis = الاتجاه
clipPosition = الموضع { $axis }، م
clipFromMiddle = من الوسط، م
clipMove = تحريك المستوى
clipFace = تحريك وجه الصندوق: { $face }
clipFlip = الجانب الآخر
reset = إعادة الضبط
boxCenter = المركز، م
boxCenterX = المركز x، م
boxCenterY = المركز y، م
boxCenterZ = المركز z، م
boxSize = الحجم، م
boxSizeX = الحجم x، م
boxSizeY = الحجم y، م
boxSizeZ = الحجم z، م
boxTurn = مدار بمقدار، °
boxRemove = إزالة الداخل
clipOutline = خط على طول القص
clipHelp = اسحب المقابض على الصورة أو اكتب القيم. الأزرق الداكن هو داخل السطح كما يُرى عبر القص. القياس والاختيار يتجاهلان ما قُصّ.
modeLevels = مستوى التفصيل
modeError = خطأ السطح
projection = الإسقاط
perspective = منظور
orthographic = متوازٍ، بمقياس صحيح
detail = التفصيل
detailError = الخطأ على الشاشة، كحد أقصى
detailHelp = الأصغر أدق ويحمّل أكثر.
pixels = { $n } بكسل
memory = الذاكرة
memoryLimit = للنموذج، كحد أقصى
memoryHelp = عند امتلائها يُنسى أولًا الأبعد عن المنظر.
turning = الدوران
turntable = على قرص: الأعلى يبقى أعلى
freely = حرّ في كل اتجاه
viewBack = المشهد السابق
viewForward = المشهد التالي
savedViews = المشاهد المحفوظة
savedNone = لا شيء بعد. أدر النموذج إلى ما تريد العودة إليه ثم احفظه.
viewSave = حفظ هذا المشهد
viewNumber = المشهد { $number }
note = ملاحظة
noteUnnamed = بلا عنوان
noteNew = ملاحظة جديدة
noteEdit = تحرير الملاحظة
noteShare = نسخ رابط هذه الملاحظة
noteTitle = العنوان
noteText = النص
noteLink = رابط
noteLinkBad = يبدأ الرابط بـ ‎https://‎ أو ‎http://‎. صحّحه أو اتركه فارغًا.
noteCamera = استعمال المشهد الظاهر
noteCameraKept = ستُعرض الملاحظة من هنا.
notePlace = اختيار مكان آخر
noteFollow = اقرأ المزيد
noteMissed = لا سطح في هذا المكان. انقر على النموذج.
notePoint = تحريك العلامة
noteChoose = اختيار المكان
notesShown = إظهار الملاحظات على النموذج
notesNone = لا شيء بعد. الملاحظة تحدّد مكانًا على السطح وتقول عنه شيئًا.
notesOwn = ترى نسختك الخاصة من الملاحظات.
notesPublished = إظهار المنشورة
tourStart = بدء الجولة
tourPrevious = الملاحظة السابقة
tourNext = الملاحظة التالية
tourCount = { $number } من { $count }
tabMeasure = قياس
toolMeasure = القياس
measurements = القياسات
measureLoading = يجري تحميل أدوات القياس.
measureFailed = تعذّر ذلك: { $why }
measureMore = كل الأدوات
measureNone = لا شيء بعد. اختر أداة واضغط مواضع على السطح؛ تصبح القيمة نهائية حين تأتي من أدق سطح.
measureUnit = الوحدة
measureSnap = الالتقاط إلى
snapNone = لا شيء
snapVertex = رؤوس الشبكة
snapCrease = الحواف
snapBorder = حدود الثقوب
planeBy = القياس من
planeFitted = المستوى الموافق
planeLowest = أفقي، أدنى زاوية
planeAtHeight = أفقي، عند ارتفاع
planeHeight = الارتفاع z، م
contoursEvery = خطوط كل، م
groupLengths = مواضع وأطوال
groupAngles = زوايا ودوائر
groupSurfaces = مساحات وحجوم
groupLines = خطوط عبر النموذج
mCoordinate = الإحداثيات
mDistance = مسافة
mPolyline = مسار
mAlong = على السطح
mPerimeter = محيط
mHeight = ارتفاع فوق مستوى
mAngle = زاوية
mPlaneAngle = زاوية مستويين
mCircle = دائرة
mArea = مساحة
mAreaWhole = المساحة الكلية للسطح
mVolume = حجم
mCutFill = حفر وردم
mDeviation = انحراف عن مستوى
mSection = مقطع
mUpright = مقطع رأسي
mLevel = مقطع أفقي
mThrough = مقطع بثلاثة مواضع
mClip = مقطع عند مستوى القص
mProfile = مقطع طولي على خط
mContours = خطوط الارتفاع
stepTool = { $tool }: { $step }
stepClick = انقر
stepTap = المس
stepHold = أطل اللمس للعدسة
stepEnd = Shift للالتقاط · Esc للخروج
stepOf = { $press } الموضع { $number } من { $count }
stepMany = { $press } الموضع { $number }
stepLeast = { $count ->
        [zero] { $count } موضع
        [one] موضع واحد
        [two] موضعان
        [few] { $count } مواضع
        [many] { $count } موضعًا
       *[other] { $count } موضع
    } على الأقل
stepDone = Enter للإنهاء · Backspace للتراجع
stepDoneTouch = علامة الصح للإنهاء
stepCorner = رأس الزاوية
stepPlane = على المستوى
stepAbove = المطلوب ارتفاعه
stepFirst = على المستوى الأول
stepSecond = على المستوى الثاني
measurePick = اختيار الموضع
measureFinish = إنهاء
measureBack = التراجع عن آخر موضع
measureLeave = ترك الأداة
backspaceKey = Backspace
measurePlaced = اختير الموضع { $number }
measureSnapped = التُقط إلى: { $what }
measureMissed = لا يلتقي أدق سطح هناك: كان الشكل الخشن يغطي فجوة. اختر موضعًا آخر.
measureMove = حرّك العلامة إلى الموضع الجديد للنقطة · المسافة للاختيار · Esc للخروج
measureMoveTouch = المس الموضع الجديد للنقطة
measureMoved = حُرّكت النقطة { $number } من { $name }.
measureEdit = تحريك النقاط
measureEditHint = اسحب نقطة من القياس لتحريكها · Esc عند الانتهاء
measureEditTouch = اسحب نقطة من القياس لتحريكها · علامة الصح عند الانتهاء
measureEditDone = إنهاء تحريك النقاط
measurePoint = تحريك النقطة { $number } من { $name }
measureDraft = قياس جديد
measureInterval = يجب أن يكون فاصل الخطوط عددًا موجبًا من الأمتار.
refining = { $value }، يجري التدقيق
refiningNoValue = يجري التدقيق
stateRefused = لا قيمة
stateMissed = لا سطح هناك
stateFailed = لم يصل
refuseUpright = الموضعان أحدهما فوق الآخر فلا يحددان مستوى رأسيًا؛ اختر موضعًا بجانب الآخر.
refuseLine = المواضع الثلاثة على خط واحد فلا تحدد مستوى؛ اختر موضعًا بجانبه.
refuseNoClip = النموذج غير مقصوص بمستوى. فعّل واحدًا أولًا في لسان القص.
refuseFew = يلزم { $needed ->
        [zero] { $needed } موضع
        [one] موضع واحد
        [two] موضعان
        [few] { $needed } مواضع
        [many] { $needed } موضعًا
       *[other] { $needed } موضع
    } على الأقل؛ أُعطي { $given }.
refuseCollinear = المواضع على خط واحد فلا تحدد شيئًا؛ أضف موضعًا بجانبه.
refuseSame = موضعان متطابقان؛ يلزم موضعان مختلفان.
refuseCross = تتقاطع أضلاع المضلع؛ حرّك موضعًا ليحيط بمساحة واحدة.
refuseOpen = السطح غير مغلق ({ $borders ->
        [zero] { $borders } حافة حدّية
        [one] حافة حدّية واحدة
        [two] حافتان حدّيتان
        [few] { $borders } حواف حدّية
        [many] { $borders } حافةً حدّيةً
       *[other] { $borders } حافة حدّية
    }) فلا يحيط بحجم. ارسم منطقة وقس الحفر والردم بالنسبة إلى مستوى.
refuseInside = لا تتفق مثلثات السطح على الجهة الخارجية فلا يحيط بحجم مؤكد.
refuseMisses = لا يلتقي أي سطح؛ ضعه عبر النموذج.
refuseGap = بين الموضعين فجوة في السطح. قس المسافة المستقيمة أو ضع مواضع في الطريق.
refuseMissesRegion = لا يقع أي سطح قرب مستوى المنطقة؛ ارسمها على السطح.
refuseMissesHeights = لا يلتقي أي خط كنتور بهذا الفاصل مع السطح؛ اختر فاصلًا أصغر.
refuseNotFinite = إحدى الإحداثيات أو النتيجة ليست عددًا منتهيًا؛ اختر نقاطًا قريبة من النموذج.
refuseNoRay = خط النظر ليس له اتجاه.
refuseNoPlane = يلزم مستوى؛ اختر واحدًا.
refusePoints = يتكوّن هذا النموذج من نقاط بلا سطح بينها. قِس الإحداثيات أو المسافات أو الزوايا أو الارتفاعات أو الدوائر أو المضلعات.
refuseWaits = لا قيمة قبل وصول السطح الأدق.
refuseReach = يجب أن يكون المدى طولًا موجبًا.
refuseInterval = الفاصل { $interval } غير ممكن: يجب أن يكون موجبًا وأن يعطي { $most } خط كنتور على الأكثر بين { $low } و{ $high }.
remarkReach = يُحسب السطح ضمن { $reach } من مستوى المضلع.
remarkInsideOut = الحجم سالب: السطح مقلوب.
remarkBody = جسم مغلق بلا أرض: لا شيء يُردم.
remarkCovered = يُحسب السطح ضمن { $reach } من المستوى ويغطي { $share } من المضلع.
remarkSpacing = على امتداد مثلثات متوسط أضلاعها { $spacing }؛ ولا تُحسب التضاريس الأدق من ذلك.
remarkRough = تختلف الارتفاعات بنحو { $deviation } من رأس إلى آخر. وبقدر ما يكون ذلك ضجيجًا تكون المساحة أكبر مما ينبغي بما يصل إلى { $share }، وهو مشمول في عدم اليقين.
remarkHoles = حيث توجد ثقوب لا يُحفر شيء ولا يُردم.
remarkLines = { $lines ->
        [zero] { $lines } خط
        [one] خط واحد
        [two] خطان
        [few] { $lines } خطوط
        [many] { $lines } خطًا
       *[other] { $lines } خط
    } (المفتوح: { $open })، عبر { $triangles ->
        [zero] { $triangles } مثلث
        [one] مثلث واحد
        [two] مثلثين
        [few] { $triangles } مثلثات
        [many] { $triangles } مثلثًا
       *[other] { $triangles } مثلث
    }
remarkHeights = { $lines ->
        [zero] { $lines } خط
        [one] خط واحد
        [two] خطان
        [few] { $lines } خطوط
        [many] { $lines } خطًا
       *[other] { $lines } خط
    } على { $heights ->
        [zero] { $heights } ارتفاع
        [one] ارتفاع واحد
        [two] ارتفاعين
        [few] { $heights } ارتفاعات
        [many] { $heights } ارتفاعًا
       *[other] { $heights } ارتفاع
    }
documentTooLong = { $bytes } بايت أكثر مما يجوز لملف قياسات ({ $most }).
documentJson = JSON غير صالح في السطر { $line }، العمود { $column }
documentOther = ليس ملف قياسات؛ نوعه «{ $kind }»
documentNewer = إصداره { $version }؛ هذه الصفحة تقرأ حتى { $known }
drawScale = يلزم مقياس مثل 1:50
drawNothing = لا شيء للرسم
drawNoLines = يُصنع الرسم من مقطع واحد أو مقطع جانبي أو خطوط كنتور
askedWrong = الطلب غير صالح
packDamaged = جزء من ملف النموذج تالف
sourceFailed = لم يصل جزء من ملف النموذج
measureColor = اللون
measureLook = التقريب إليه
measureCopy = نسخ القيم
measureCopied = نُسخت القيم
measureCopyFailed = لا يسمح المتصفح بالنسخ. حدّد النص بدلًا من ذلك.
measureCite = الاستشهاد به
measureCited = نُسخت جملة الاستشهاد
measureHide = إخفاؤه على النموذج
measureShow = إظهاره على النموذج
measureDrawing = رسم، { $format }
plotKeys = يتبع اليسار واليمين الخط، وينتقل الأعلى والأسفل إلى خط آخر، ويكبّر + ويصغّر −، ويُظهر 0 الرسم كله
plotName = رسم { $name }
plotLine = الخط { $number } من { $count }
plotHint = أشر إلى الرسم لقراءة الإحداثيات.
plotAlong = المسافة
plotWhole = إظهار الرسم كله
plotLarge = تكبير الرسم
plotSize = { $width } × { $height } مم على الورق
plotTooLarge = عند 1:{ $scale } يكون الرسم { $width } × { $height } مم، أكثر مما تسعه الورقة. اختر مقياسًا أصغر أو ورقة أكبر أو ورقة بحجم الرسم.
measureMap = إظهار البعد بالألوان
measureRead = البيانات المقروءة
measureReadOf = { $bytes } من { $all }
measureUncertainty = عدم اليقين المعياري لكل إحداثي
partLattice = شبكة الإحداثيات
partLevel = مستوى التفصيل
partCapture = المسح
partPointing = التأشير
gridOnly = شبكة الإحداثيات فقط؛ دقة المسح غير معروفة
gridPointingOnly = شبكة الإحداثيات والتأشير فقط؛ دقة المسح غير معروفة
unknownCapture = مجهول: القيمة ليست أوثق من المسح
measureDeleteAll = حذف الكل
measureAllDeleted = { $count ->
        [zero] لم يُحذف أي قياس.
        [one] حُذف قياس واحد.
        [two] حُذف قياسان.
        [few] حُذفت { $count } قياسات.
        [many] حُذف { $count } قياسًا.
       *[other] حُذف { $count } قياس.
    }
measureFormat = صيغة الملف
fileJson = JSON لإعادة القراءة
fileCsv = CSV جدول
fileGeojson = GeoJSON للخرائط
fileDxf = DXF للتصميم
measureLinkLong = القياسات أكثر من أن يحملها رابط: فيه المنظر وحده. احفظها في ملف.
measureLinkCut = تعذّرت قراءة { $count ->
        [zero] { $count } قياس
        [one] قياس واحد
        [two] قياسين
        [few] { $count } قياسات
        [many] { $count } قياسًا
       *[other] { $count } قياس
    } من الرابط؛ ربما قُطع.
measureOtherPack = أُجريت هذه القياسات على نموذج آخر: «{ $title }» ({ $identity }…). هذا هو «{ $here }».
measureOtherVersion = أُجريت هذه القياسات على نسخة أخرى من هذا النموذج: «{ $title }» ({ $identity }…)، لا على «{ $here }» كما هو هنا.
measureAddAnyway = قسها هنا
measureForeign = مواضعه من ملف آخر، «{ $title }» ({ $identity }…)؛ وقيست القيم من جديد على هذا.
rStraight = مستقيم
rHorizontal = أفقي
rVertical = رأسي
rEnds = من الطرف إلى الطرف
rPerimeter = المحيط
rAlong = على السطح
rAngle = الزاوية
rSlope1 = الميل الأول
rSlope2 = الميل الثاني
rHeight = الارتفاع
rFitted = المستوى الموافق
rPlan = المسقط
rOut = خارج المستوى
rSurface = السطح
rRadius = نصف القطر
rDiameter = القطر
rCircumference = محيط الدائرة
rResidual = الباقي
rVolume = الحجم
rCut = الحفر
rFill = الردم
rNet = الصافي
rBase = القاعدة
rAbove = فوق المستوى
rBelow = تحت المستوى
rLength = الطول
rMaterial = المادة
rWay = الطول في المسقط
rOnSurface = الطول على السطح
rLowest = الأدنى
rHighest = الأعلى
rAll = الطول الكلي
rMean = المتوسط
rRms = جذر متوسط المربعات
rDeviation = الانحراف المعياري
rArea = المساحة
deviationShow = إظهاره بالألوان
citeSentence = { $name } ({ $tool }): { $values }. قيس{ $date } على أدق سطح لنموذج «{ $title }» (الملف { $identity }) ببرنامج { $program }؛ { $capture }.
citeDate = { " " }بتاريخ { $date }
citeCapture = دقة المسح { $value }
citeCaptureUnknown = دقة المسح مجهولة
undo = تراجع
redo = إعادة
undoNamed = تراجع: { $what }
redoNamed = إعادة: { $what }
undoneNamed = تم التراجع: { $what }
redoneNamed = تمت الإعادة: { $what }
editMeasure = قياس
editMove = تحريك نقطة
editRename = تغيير الاسم
editColor = تغيير اللون
editHide = إخفاء
editShow = إظهار
editReorder = تغيير الترتيب
editDelete = حذف
editDeleteAll = حذف الكل
editNote = تحرير ملاحظة
editNoteAdd = إضافة ملاحظة
editNotePlace = تحريك ملاحظة
editPublished = العودة إلى الملاحظات المنشورة
editView = حفظ منظر
editImport = قراءة ملف
editLink = إضافة قياسات الرابط
edit = تعديل
name = الاسم
moveUp = تحريك إلى أعلى
moveDown = تحريك إلى أسفل
delete = حذف
deleted = حُذف «{ $name }».
done = تم
cancel = إلغاء
notKept = لا يحفظ هذا المتصفح شيئًا للصفحة: احفظ ملفًا قبل إغلاقها.
exportFile = حفظ في ملف
importFile = قراءة ملف…
imported = قُرئ { $count }.
importFailed = تعذّرت قراءة الملف: { $why }
importNoViews = لا يحوي مشاهد محفوظة من Kilwa
importNoNotes = لا يحوي Web Annotations
importBadView = المشهد { $number } بلا كاميرا صالحة
importTooMany = العدد { $count } كبير جدًا؛ أقصى ما يمكن { $most }
importLeft = { $count ->
        [zero] لم تُترك أي ملاحظة بلا مكان على النموذج.
        [one] تُركت واحدة بلا مكان على النموذج.
        [two] تُركت اثنتان بلا مكان على النموذج.
        [few] تُركت { $count } بلا مكان على النموذج.
        [many] تُركت { $count } بلا مكان على النموذج.
       *[other] تُركت { $count } بلا مكان على النموذج.
    }
pictureSize = الحجم
pictureCanvas = كما على الشاشة
pictureDouble = ضعف الحجم
picture4k = 4K
pictureCustom = حجم آخر
pictureSheet = رسم بمقياس
sheetView = المنظر
sheetScale = المقياس، 1 إلى
sheetDpi = نقاط في البوصة
sheetPaper = الورق
paperAuto = أصغر ما يتسع له
paperFit = بحجم الرسم
paperCustom = حجم آخر
paperSize = العرض × الارتفاع، مم
sheetFormat = نوع الملف
sheetDone = حُفظ رسم بمقياس 1:{ $scale } على { $width } × { $height } مم
sheetCoarse = حُفظ رسم بمقياس 1:{ $scale } على { $width } × { $height } مم؛ أجزاء منه أخشن من نقاطه لأن الذاكرة لم تكف. امنح النموذج ذاكرة أكبر، أو اختر نقاطا أقل في البوصة.
sheetTooLarge = عند 1:{ $scale } يكون النموذج { $width } × { $height } مم، أكثر مما تسعه الورقة. اختر مقياسًا أصغر أو ورقة بحجم الرسم.
sheetTooLargeFits = عند 1:{ $scale } يكون النموذج { $width } × { $height } مم، أكثر مما تسعه الورقة. يتسع عند 1:{ $fits }، أو اختر ورقة بحجم الرسم.
sheetTooLong = الرسم أطول من أن يسعه ملف بهذه الصيغة. اختر نقاطًا أقل في البوصة أو صيغة أخرى.
sheetTooFine = { $width } × { $height } بكسل أكثر من اللازم. اختر مقياسًا أصغر أو نقاطًا أقل في البوصة أو ورقة أخرى.
sheetNoScale = يلزم مقياس مثل 1:50، من 1:0.01 إلى 1:1000000.
sheetDots = من { $low } إلى { $high } نقطة في البوصة ممكنة.
sheetOblique = المنظر المائل لا مقياس له. اختر المسقط الأفقي أو واجهة.
sheetNoPaper = يُكتب حجم الورقة عرضًا × ارتفاعًا بالمليمتر، مثل 900x600، من 20 إلى 50000.
sheetBare = النموذج وحده
sheetWorld = ملف الإسناد الجغرافي
pictureWidth = العرض، بكسل
pictureHeight = الارتفاع، بكسل
pictureScale = مع مقياس الرسم
pictureClear = خلفية شفافة
pictureMake = حفظ الصورة
pictureWorking = تُجهَّز الصورة
pictureDone = حُفظت صورة { $width } × { $height } بكسل
pictureFailed = تعذّر إنشاء الصورة: { $why }. قد تنجح صورة أصغر.
pictureLimits = يجب أن يكون العرض والارتفاع عددين صحيحين من 16 إلى { $most }.
triangles = المثلثات
vertices = النقاط
extent = الأبعاد
spacing = أدق تباعد
grid = شبكة الإحداثيات
file = الملف
crs = نظام الإسناد
crsLocal = محلي
licence = الترخيص
licenceUnknown = غير مذكور
technicalFacts = بيانات تقنية
creators = المُعِدّون
placeName = المكان
objectKind = النوع
objectDate = تاريخ البناء
objectPeriod = الحقبة
objectMaterials = المواد
captureDate = تاريخ المسح
captureMethod = الطريقة
captureInstruments = الأجهزة
publisher = الناشر
drawings = رسوم
howToCite = كيفية الاستشهاد
otherPrograms = الفتح في برامج أخرى
files = الملفات
versions = الإصدارات
accuracy = دقة المسح
accuracyUnknown = غير مذكورة
sources = صُنع من
repairs = ما أُصلح أو تُرك
tool = صُنع باستخدام
drawn = المثلثات على الشاشة
pixelError = أكبر خطأ على الشاشة
surfaceError = أكبر خطأ في السطح
chunks = الأجزاء في الذاكرة
gpuMemory = ذاكرة الرسوميات
received = المستلَم
requests = الطلبات
failures = ما فشل وأُعيد
memoryOf = { $used } من { $limit }
infoHelp = الخطأ موثّق عند بناء الملف: لا تبعد أي نقطة من السطح المعروض عن السطح الأدق أكثر من هذا.
status = الحالة
shownTo = السطح معروض بدقة { $error }
shownFull = السطح معروض كاملًا
complete = حُمّل { $received }
toLoad = بقي { $missing }
memoryFull = بلغ حد الذاكرة
cutOff = الملف غير مكتمل، والأجزاء الأدق ناقصة
close = إغلاق
helpMouse = الفأرة
helpTouch = الأصابع
helpKeys = المفاتيح
turn = إدارة
move = تحريك
zoom = تقريب وإبعاد
pivot = إدارة حول نقطة
standThere = أثناء السير: قف هناك
lean = تدوير أو إمالة
views6 = المناظر القياسية
leftDrag = الزر الأيسر والسحب
rightDrag = الزر الأيمن أو Shift والسحب
wheel = العجلة
doubleClick = نقر مزدوج
oneFinger = إصبع واحدة
twoFingers = إصبعان
pinch = ضم وفتح
twist = لفّ الإصبعين
doubleTap = لمس مزدوج
keysOn = اختصارات المفتاح الواحد
keysHelp = أوقفها إن كانت تُضغط دون قصد. تعمل الأسهم وTab وEnter والمسافة وEsc دائمًا، ولكل شيء زر.
arrows = الأسهم
shiftArrows = Shift مع الأسهم
shiftKey = Shift { $key }
spaceKey = مسافة
legendFinest = الأدق
insideHelp = يميّز الأزرق باطن السطح: هناك يُرى المسح من الخلف.
