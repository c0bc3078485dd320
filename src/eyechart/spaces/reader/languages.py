"""Replies in other languages, word by word in English, so that the rules of reading are written once.

Only words about a choice are known: who chooses, what is chosen, by which verb, why, or why not.
Articles are left out, since a mark follows them: "la 3". Other words stay as they are.
"""

import re
from functools import lru_cache

_GLOSSES = {
    "": "der die das den dem le la les el los il lo gli het yo eu io mich wählen nehmen "
    "ausführen betragen fahren lenken kiezen nemen vaut me am",
    "i": "ich je ik jag я",
    "i go": "voy vou vado irais vais",
    "i think": "creo pienso acho penso credo думаю",
    "think": "denke glaube pense crois",
    "i choose": "quedo elijo elegiría escojo escogería selecciono seleccionaría recomiendo recomendaría sugiero "
    "propongo "
    "diría optaría opto escolho escolheria recomendo recomendaria sugiro proponho seleciono selecionaria diria "
    "optaria scelgo sceglierei consiglio consiglierei raccomando suggerisco seleziono selezionerei direi opterei "
    "wybieram polecam выбираю выберу рекомендую предлагаю обираю",
    "choose": "wähle nehme empfehle entscheide schlage elegir escoger tomar tomo choisis choisirais choisirai "
    "choisir prends prendrais prendre opte opterais recommande recommanderais suggère conseille dirais sélectionne "
    "escolher выбрать "
    "prendo prenderei scegliere kies neem adviseer väljer consigliare suggerire proporre recomendar sugerir proponer",
    "would": "würde zou skulle",
    "i would": "vorrei quisiera gostaria",
    "avoid": "evitare evitar éviter vermeiden vermijden",
    "should": "sollte sollten muss soll doit devrait dois devons debe debería deberíamos debemos deve deveria devo "
    "dovrebbe dovremmo moet bör powinien должен",
    "we should": "faut нужно надо",
    "for": "für por per pour voor för",
    "a": "ein eine einen un una uno um uma een",
    "it": "ce",
    "with": "mit avec con com met",
    "at": "à",
    "chosen": "choisie choisi elegida elegido scelto escolhida escolhido gewählte gewählter",
    "is": "lautet sia est ist è é är jest sería serait wäre seria sarebbe",
    "be": "sein être ser essere zijn",
    "option": "alternativa opción opcion opção opzione optie opcja opcję вариант letra lettre lettera buchstabe буква",
    "number": "nummer número numéro",
    "solution": "lösung solución solução soluzione",
    "turn": "girar gire girare drehen tournerais",
    "action": "acción accion ação azione aktion actie akcja akcję действие maniobra manobra manovra manöver",
    "answer": "respuesta resposta réponse reponse risposta antwort antwoord odpowiedź svaret svar ответ відповідь",
    "choice": "elección eleccion choix escolha scelta wahl keuze wybór выбор",
    "decision": "decisión decision décision decisão decisione entscheidung beslissing решение рішення",
    "recommendation": "recomendación recommandation recomendação raccomandazione empfehlung aanbeveling",
    "speed": "geschwindigkeit vitesse velocidad velocità velocidade snelheid скорость prędkość",
    "steering": "lenkung dirección direction direção direzione giro braquage sterzo sterzata volante volant руль "
    "поворота",
    "steering value": "lenkwert lenkbefehl lenkeinschlag einschlag lenkstufe stuurwaarde",
    "steering angle": "lenkwinkel stuurhoek",
    "angle": "winkel ángulo angulo ângulo angolo угол",
    "value": "valor valeur valore wert waarde значение",
    "of": "de von du di del do da des",
    "best": "mejor meilleur meilleure beste besten bester bestes melhor migliore лучшее лучший najlepsza",
    "correct": "correcta correcto correcte richtige richtiger richtigen correta correto corretta corretto bonne "
    "bon juiste richtig certa certo giusta giusto правильный правильное",
    "better": "besser mieux plutôt meglio lieber eher",
    "appropriate": "adecuado adecuada apropiado apropiada approprié appropriée adequado adequada adeguato adeguata "
    "angemessene passende geeignete óptimo óptima optimale idéale ottimale",
    "recommended": "recomendado recomendada recommandé recommandée empfohlene empfohlener consigliato consigliata",
    "my": "mi mon ma meine mein minha meu mia mio mijn min моя мой moja",
    "so": "daher somit deshalb darum also folglich donc alors entonces então portanto quindi perciò dus поэтому "
    "следовательно",
    "because": "weil da denn car parce que che puisque porque pues ya pois já poiché perché omdat want потому",
    "if": "wenn falls si se если",
    "or": "oder ou oppure или eller",
    "and": "und et",
    "not": "nicht kein keine pas não non nunca nie niemals jamais niet не нельзя inte",
    "no": "nein нет nee nej",
    "maybe": "vielleicht quizás quizá talvez forse misschien возможно",
    "but": "aber sondern mais pero mas но maar",
    "now": "jetzt maintenant ahora agora adesso сейчас",
    "then": "dann puis luego después depois poi затем потом",
    "dangerous": "gefährlich peligroso peligrosa dangereux dangereuse perigoso perigosa pericoloso pericolosa",
    "the robot": "roboter robot robô fahrzeug véhicule vehículo veículo veicolo",
    "other": "outro outra otro otra altro altra autre",
    "execute": "executar ejecutar exécuter eseguire uitvoeren",
    "steer": "lenke",
    "drive": "fahre roulerais",
}
"""English, and the words of other languages for it."""
_ENGLISH = {word: english for english, words in _GLOSSES.items() for word in words.split()}
_SHARED = (
    "den die un uno um la le les el il lo un una das also da car decision robot non nie se si mi ma mon min per "
    "por pour pas opto "
    "giro volante volant want propose do du of at com met et poi ou ser dem recommande direction as or no se mais mas "
    "ya de di del des que yo me suggestion conseille puis dus son moet maar eher inte svar wart con alors ja é "
    "sia am ce vou vado bon turn acho penso credo certa certo von"
)
"""Words that are also English or a name's: they do not show that a reply is in another language."""
_DOUBTFUL = frozenset(
    ["est", "falls", "hay", "los", "jest", "mit", "io", "eu", "je", "agora", "outro", "valor", "mia", "che"]
)
"""Words that may be English, which other English words decide: "the gap falls"."""
_PLAINLY_ENGLISH = frozenset(["the", "is", "are", "and", "of", "at", "this", "it"])
_OTHERS = "und está são zu auf sind hay dans sur nella della pelo uma é tem"
_SHOWN = (frozenset(_ENGLISH) - {*_SHARED.split()}) | {*_OTHERS.split()}
_WORD = re.compile(r"[^\W\d_]+(?:-être)?")
_ELIDED = re.compile(r"\b([ljc])['’]\s?(?=[^\W\d_])", re.IGNORECASE)
_MARK = r"(?=[\"'(]?(?:[A-Z]\b(?!')|[+-]?\.?\d))"
_JOINED = (
    (re.compile(rf"\b(is|be)\s+(?:of|a|o)\s+{_MARK}"), r"\1 "),
    (
        re.compile(r"\b[Ee]s\s+is\b|(?:^|(?<=[.!?;,]\s)|(?<=because ))[Ee]s\s(?=\s*[\"'(]?[A-Z\d+-])", re.MULTILINE),
        "it is ",
    ),
    (re.compile(r"\bthink because\b"), "think"),
    (re.compile(r"\bi think should\b"), "i should"),
    (re.compile(r"\bi would of\b"), "i would"),
    (re.compile(r"\bes\s(?!\s*(?:is|sind|gibt|wird|hat|steht)\b)(?:\s*of\s)?"), "is "),
    (re.compile(rf"\bshould\s+{_MARK}"), "should be "),
    (re.compile(r"\b(choose|would)\s+i\b"), r"i \1"),
    (re.compile(r"\bchoose\s+(?:for|with)\b"), "choose"),
    (re.compile(r"\bother the robot\b"), "the other robot"),
    (re.compile(r"\b(?:at|a|because) choose (?=is\b)"), "chosen "),
    (re.compile(r"\b[ao]\s+(?=(?:option|action|answer|choice|decision)\b)", re.IGNORECASE), ""),
    (re.compile(r"\b(value|angle)(?:\s+of)?\s+steering\b", re.IGNORECASE), r"steering \1"),
    (
        re.compile(r"\b(speed|angle|value|action|option|answer) (recommended|appropriate|correct|chosen)(?=\s*:)"),
        r"\2 \1",
    ),
    (re.compile(rf"\b(best|better)((?:\s+[^\s.,;:!?]+){{0,4}}) (?:of )?because {_MARK}"), r"\1\2 than "),
    (re.compile(r"\bno[nt]?\s+is\b"), "is not"),
    (re.compile(r"\bnot(?=,)"), "no"),
    (re.compile(r"\bnot(?=\s*(?:[.,;]|$))"), "is wrong"),
)
"""The order of words."""
_NEAR = re.compile(r"[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7af]")
_CAR = r"(?<![\u3400-\u9fffの])"
_CJK = (
    (r"((?:速度|角度?|舵角)は\s?[+-]?[\d.]+\s?(?:m/s|度|°)?)\s?(?:に|と)します", r"\1 "),
    (r"(?:私|僕)は", " "),
    (r"不(?:[行可好]|安全)", " is wrong "),
    (r"ではなくて?|じゃなくて?", " is wrong, "),
    (r"だと(?:思い|考え)ます|でお願いします|(?<=[A-Z])项", " "),
    (r"执行|実行する", " execute "),
    (r"로 (?:주행|이동|가겠|갑)\S*", " is my choice "),
    (r"なので|ので|から(?=[、,])", " so "),
    (r"し(?:ます|てください|ましょう)(?=[\s.。]|$)", " "),
    (
        r"(?:ではありません|ではない|じゃない|は(?:選び|選択し)(?:ません|ない)|を(?:選び|選択し)(?:ません|ない))",
        " is wrong ",
    ),
    (r"(?:べき)?ですか|ますか|吗|습니까|까요", " ? "),
    (
        (
            r"を(?:選択|選び|選ぶ|実行|採用|推奨|取り|とり)(?:し?(?:ます|た|する|て)(?:ください)?|いたします)?|(?:을|를)\s?선택\S{0,6}|にします|とします"
        ),
        " is my choice ",
    ),
    (
        (
            r"[がは](?:最も|一番)?(?:最適|適切|最善|最良|正解|良い|よい|いい)(?:です|だ|でしょう)?(?:と(?:思い|考え)ます)?|(?:是)?最(?:合适|适合|好|佳|安全"
            r"|优)(?=[的。,.，\s]|$)(?:的(?:选择|选项)?)?|(?:이|가)\s?(?:가장\s?)?(?:적절|적합|최선|안전|좋)\S{0,4}"
        ),
        " is best ",
    ),
    (r"(?:は|是|는|은)(?:危険|危险|위험)\S{0,3}", " is dangerous "),
    (r"(?:です|だ|である|でございます|입니다|이다|이에요)(?=[\s.,!。、！]|$)", " "),
    (r"(?:不|别|勿)(?:应该?|能|要|会|可以?|建议|推荐)?(?:选择?)?", " not "),
    (r"如果|若是?|假如|もし|만약", " if "),
    (r"れば|なら|たら", " if "),
    (r"(?<=[A-Z\d])\s?(?:か|或者?|和|と|및|또는|还是)\s?(?=[A-Z\d])", " or "),
    (r"所以|因此|故|したがって|よって|従って|따라서|그러므로", " so "),
    (r"(?:我们?)?(?:应该?|應該?)(?:选择?|選擇?|执行|采取)?(?:是|为|為)?", " we should choose "),
    (r"我?(?:会|将|要|想)?(?:选择?|選擇?|建议|推荐)(?:是|了)?(?=\s*[\"'(]?[A-Z\d+-]|[动行]作|选项)", " I choose "),
    (r"最佳的?|最好的?|最優|最优的?|最適な?|最善の?|최선의|최적의", " best "),
    (r"正确的?|正確な?|正しい|適切な|올바른|合适的?", " correct "),
    (r"(?:动作|動作|行动|行動|操作|アクション|행동|동작)(?:编号|番号|번호)?", " action "),
    (r"选项|選択肢|선택지|옵션|オプション|方案", " option "),
    (r"答案|答え|正解|回答|정답|답변|(?<!\w)답", " answer "),
    (r"决定|決定|결정|决策", " decision "),
    (r"推荐的?|推奨|권장|建议", " recommended "),
    (
        rf"{_CAR}(?:方向盘|转向|操舵|舵|ステアリング|ハンドル|조향)?(?:角度?|转角|각)(?:应?[は是为為은는])?",
        " steering angle: ",
    ),
    (
        rf"{_CAR}(?:方向盘|转向|操舵|舵|ステアリング|ハンドル|조향)角?(?:档位|级别|值|値|값)?(?:[は是为為은는](?=\s*[+-]?\d)|(?!\s?[角转]|각))",
        " steering value: ",
    ),
    (rf"{_CAR}(?:速度|속도|车速)(?:应?[は是为為은는])?", " speed: "),
    (r"(?:は|是|为|為|은|는)(?=\s*[\"'(「『«“]?(?:[A-Z]|[+-]?\d))|(?:は|是)(?=[「『])", " is "),
    (r"(?<=\d)(?:번(?!째)|番(?=\s*(?:[をがで]|is\b))|号\s*(?:action|option))", " "),
    (r"因为|因為|ため", " because "),
)
_SIGNS = tuple((re.compile(pattern), english) for pattern, english in _CJK)


def is_foreign(text: str) -> bool:
    """Return whether a text has words of another language than English."""
    words = frozenset(_WORD.findall(text.lower()))
    shown = words & _SHOWN
    if shown - _DOUBTFUL or (shown and words.isdisjoint(_PLAINLY_ENGLISH)):
        return True
    return _NEAR.search(text) is not None


def in_english(text: str, names: tuple[str, ...]) -> str:
    """Return a text with English words for those about a choice, but for the words of the names."""
    if _NEAR.search(text) is not None:
        for sign, english in _signs_beside(names):
            text = sign.sub(english, text)
    own = _words_of(names)
    text = _ELIDED.sub(r"\1e ", text)
    text = _WORD.sub(lambda word: _gloss(word.group(), own), text)
    for joined, english in _JOINED:
        text = joined.sub(english, text)
    return _SPACES.sub(" ", text)


_SPACES = re.compile(r"[ \t]{2,}")


def _gloss(word: str, own: frozenset[str]) -> str:
    plain = word.lower()
    return word if plain in own else _ENGLISH.get(plain, word)


@lru_cache(maxsize=256)
def _words_of(names: tuple[str, ...]) -> frozenset[str]:
    return frozenset(word for name in names for word in _WORD.findall(name.lower()))


@lru_cache(maxsize=256)
def _signs_beside(names: tuple[str, ...]) -> tuple[tuple[re.Pattern[str], str], ...]:
    """Return the signs that are no part of a name."""
    return tuple(one for one in _SIGNS if not any(one[0].search(name) for name in names))
