### Messages for the list of holes (www/holes.js). The page loads them only if there is such a list.

holes = الثقوب
holesShow = إظهار حدود الثقوب
holesCount = { $count ->
        [zero] لا ثقوب.
        [one] ثقب واحد، { $area }.
        [two] ثقبان، { $area }.
        [few] { $count } ثقوب، { $area }.
        [many] { $count } ثقبًا، { $area }.
       *[other] { $count } ثقب، { $area }.
    }
holesRest = الأصغر، غير الظاهرة: { $count }.
holeUnseen = لم تره أي محطة
holeFree = يُرى من خلاله (فتحة)
holeDropped = قيس ثم استُبعد
holeNoReturn = بلا إشارة مرتدة
holeSize = { $area }، الحافة { $length }
holesFailed = تعذّرت قراءة قائمة الثقوب: { $why }
holesForm = ليست القائمة التي كتبها kilwa merge --holes مع هذا النموذج
