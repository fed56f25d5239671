// What preview.js says, in the languages of the viewer. {host} is the Dataverse installation, {here} the origin of this page.

/** @type {Record<string, Record<string, string>>} */
export const WORDS = {
  en: {
    reading: "Reading the file…",
    noFile: "The address of this page names no file. Open the file in Dataverse, and choose this tool there.",
    noCall: "{host} gave no address for the contents of the file. The manifest of this tool needs the call retrieveFileContents.",
    expired: "The link from {host} has expired. Open the file in Dataverse again.",
    restricted: "This file is restricted. Sign in at {host} with an account that has access to it, and open the file again.",
    missing: "{host} does not have this file any more.",
    server: "{host} answers with error {status}. Try again later.",
    unreachable: "{host}, or the storage to which it redirects, does not answer or does not allow {here} to read files. Its operator can allow it (CORS).",
    noRange: "{host} sends this file only as a whole. The file is {size} MB; above 64 MB, models can be shown only if the server answers Range requests.",
    notPack: "This file is not a Kilwa pack, so it cannot be shown as a 3D model.",
  },
  fr: {
    reading: "Lecture du fichier…",
    noFile: "L’adresse de cette page ne désigne aucun fichier. Ouvrez le fichier dans Dataverse et choisissez-y cet outil.",
    noCall: "{host} n’a pas donné d’adresse pour le contenu du fichier. Le manifeste de cet outil doit contenir l’appel retrieveFileContents.",
    expired: "Le lien fourni par {host} a expiré. Ouvrez à nouveau le fichier dans Dataverse.",
    restricted: "L’accès à ce fichier est restreint. Connectez-vous sur {host} avec un compte qui y a accès, puis ouvrez à nouveau le fichier.",
    missing: "{host} n’a plus ce fichier.",
    server: "{host} répond par l’erreur {status}. Réessayez plus tard.",
    unreachable:
      "{host}, ou le stockage vers lequel il redirige, ne répond pas ou n’autorise pas {here} à lire ses fichiers. Son exploitant peut l’autoriser (CORS).",
    noRange:
      "{host} n’envoie ce fichier qu’en entier. Il fait {size} Mo ; au-delà de 64 Mo, un modèle ne peut s’afficher que si le serveur répond aux requêtes Range.",
    notPack: "Ce fichier n’est pas un pack Kilwa et ne peut donc pas s’afficher comme modèle 3D.",
  },
  pt: {
    reading: "A ler o ficheiro…",
    noFile: "O endereço desta página não indica nenhum ficheiro. Abra o ficheiro no Dataverse e escolha lá esta ferramenta.",
    noCall: "{host} não indicou um endereço para o conteúdo do ficheiro. O manifesto desta ferramenta precisa da chamada retrieveFileContents.",
    expired: "A ligação fornecida por {host} expirou. Abra de novo o ficheiro no Dataverse.",
    restricted: "O acesso a este ficheiro é restrito. Inicie sessão em {host} com uma conta que tenha acesso e abra de novo o ficheiro.",
    missing: "{host} já não tem este ficheiro.",
    server: "{host} responde com o erro {status}. Tente mais tarde.",
    unreachable:
      "{host}, ou o armazenamento para onde redireciona, não responde ou não permite que {here} leia ficheiros. O seu operador pode permiti-lo (CORS).",
    noRange: "{host} só envia este ficheiro inteiro. Tem {size} MB; acima de 64 MB, um modelo só pode ser mostrado se o servidor responder a pedidos Range.",
    notPack: "Este ficheiro não é um pack Kilwa, por isso não pode ser mostrado como modelo 3D.",
  },
  sw: {
    reading: "Inasoma faili…",
    noFile: "Anwani ya ukurasa huu haitaji faili yoyote. Fungua faili katika Dataverse na uchague zana hii hapo.",
    noCall: "{host} haikutoa anwani ya yaliyomo kwenye faili. Manifest ya zana hii inahitaji mwito retrieveFileContents.",
    expired: "Kiungo kutoka {host} kimekwisha muda. Fungua faili tena katika Dataverse.",
    restricted: "Ufikiaji wa faili hii umezuiwa. Ingia kwenye {host} kwa akaunti yenye ruhusa, kisha ufungue faili tena.",
    missing: "{host} haina tena faili hii.",
    server: "{host} imejibu kwa kosa {status}. Jaribu tena baadaye.",
    unreachable: "{host}, au hifadhi inayoelekeza, haijibu au hairuhusu {here} kusoma faili. Mwendeshaji wake anaweza kuruhusu (CORS).",
    noRange: "{host} hutuma faili hii nzima tu. Ina MB {size}; zaidi ya MB 64, modeli huonyeshwa tu kama seva inajibu maombi ya Range.",
    notPack: "Faili hii si pack ya Kilwa, kwa hiyo haiwezi kuonyeshwa kama modeli ya 3D.",
  },
  ar: {
    reading: "جارٍ قراءة الملف…",
    noFile: "عنوان هذه الصفحة لا يحدد أي ملف. افتح الملف في Dataverse واختر هذه الأداة هناك.",
    noCall: "لم يقدّم {host} عنوانًا لمحتوى الملف. يحتاج بيان هذه الأداة إلى الاستدعاء retrieveFileContents.",
    expired: "انتهت صلاحية الرابط المقدّم من {host}. افتح الملف في Dataverse مرة أخرى.",
    restricted: "الوصول إلى هذا الملف مقيّد. سجّل الدخول في {host} بحساب له حق الوصول، ثم افتح الملف مرة أخرى.",
    missing: "لم يعد هذا الملف موجودًا في {host}.",
    server: "يجيب {host} بالخطأ {status}. حاول لاحقًا.",
    unreachable: "لا يجيب {host}، أو التخزين الذي يحوّل إليه، أو لا يسمح لـ {here} بقراءة الملفات. يمكن لمشغّله السماح بذلك (CORS).",
    noRange: "يرسل {host} هذا الملف كاملًا فقط. حجمه {size} ميغابايت؛ وفوق 64 ميغابايت لا يمكن عرض النموذج إلا إذا كان الخادم يجيب طلبات Range.",
    notPack: "هذا الملف ليس حزمة Kilwa، لذلك لا يمكن عرضه كنموذج ثلاثي الأبعاد.",
  },
};
