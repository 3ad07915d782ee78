"""Names that German, English and French laboratories give to the channels we need."""

from __future__ import annotations

import functools
import re
import unicodedata
from dataclasses import dataclass
from typing import Final

from beltid.bench.formats.dialect import POSITION, without_unit
from beltid.tables import schemas

_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")
"""Prefix that a recorder puts before the name of a channel."""
_LEAST_HINT: Final = 4
"""Fewest letters of a word that is a hint anywhere in a name."""
_UMLAUTS: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


@dataclass(frozen=True, slots=True)
class Words:
    """Names of a channel.

    A name matches if it contains one of the `keys` as whole words and otherwise only `fillers`:
    "Trumkraft Zugtrum" matches by its key "zugtrum" and its filler "trumkraft".

    Attributes
    ----------
    keys : tuple of str
        Words, or sequences of words, that identify the channel.
    fillers : frozenset of str
        Words that may be added to them.
    """

    keys: tuple[str, ...]
    fillers: frozenset[str] = frozenset()

    def mean(self, name: str) -> bool:
        """Return whether a simplified name matches."""
        for key in self.keys:
            if key not in name:
                continue
            rest, hits = _as_words(key).subn(" ", name, count=1)
            if hits and all(word in self.fillers for word in rest.split()):
                return True
        return False


@functools.cache  # of the few hundred keys below
def _as_words(key: str) -> re.Pattern[str]:
    return re.compile(rf"\b{re.escape(key)}\b")


def _words(keys: str, fillers: str = "") -> Words:
    key_words = tuple(key.strip() for key in keys.split(","))
    return Words(tuple(sorted(key_words, key=len, reverse=True)), frozenset(fillers.split()))


_DATE: Final = _words("datum,messdatum,pruefdatum,date,jour", "de du of the essai test")
_TIME: Final = _words(
    "uhrzeit,zeitpunkt,datum zeit,datum uhrzeit,date time,datetime,clock time,time of day,"
    "heure,date heure,horodatage,zeit,pruefzeit,versuchszeit,messzeit,laufzeit,time,times,"
    "test time,elapsed time,running time,total time,relative time,temps,temps ecoule,timestamp,"
    "time stamp,zeitstempel,t,x value",
    "s sec von de du the rel 1 standardmessrate default sample rate",
)
_TEMPERATURE: Final = _words(
    "temperatur,temperature,temp,pruefraumtemperatur,ofentemperatur,kammertemperatur,"
    "probentemperatur,raumtemperatur,umgebungstemperatur,riementemperatur,prueftemperatur",
    "c degc probe specimen chamber oven belt ambient room kammer ofen riemen de du la courroie "
    "enceinte eprouvette essai test pruef",
)
_TIGHT: Final = _words(
    "tight,zugtrum,lasttrum,arbeitstrum,zugtrumkraft,lasttrumkraft,ziehend,ziehendes,gezogen,"
    "straff,straffes,tendu",
    "tension force span side strand load cell n t f kraft trum trumkraft zugkraft seite seilkraft "
    "kraftaufnehmer kmd brin effort force de du cote belt riemen in im the trumm t1 f1",
)
_SLACK: Final = _words(
    "slack,leertrum,leertrumkraft,leer,leeres,lose,loses,schlaff,schlaffes,mou",
    " ".join(sorted(_TIGHT.fillers - {"t1", "f1"})) + " t2 f2",
)
_INITIAL: Final = _words(
    "initial tension,initial force,initial load,pretension,pre tension,pretension force,preload,"
    "pre load,static tension,vorspannkraft,vorspannung,vorkraft,trumvorspannkraft,"
    "riemenvorspannung,"
    "anfangskraft,tension initiale,force initiale,tension de pose,pretension initiale,precharge,"
    "t0,f0",
    "n belt riemen force kraft soll nominal set setpoint nennwert sollwert de la courroie target",
)
_ARC: Final = _words(
    "umschlingungswinkel,umschlingung,umschlingungsbogen,kontaktwinkel,kontaktbogen,contact arc,"
    "contact angle,wrap angle,wrap,angle of wrap,arc of contact,arc,arc de contact,"
    "angle d enroulement,angle de contact,enroulement",
    "deg soll nominal set the of scheibe pulley",
)
_SPEED: Final = _words(
    "n scheibe,n riemenscheibe,n pulley,n poulie,drehzahl,winkelgeschwindigkeit,"
    "scheibendrehzahl,umfangsgeschwindigkeit,speed,rpm,upm,u min,1 min,"
    "tr min,min 1,omega,"
    "angular speed,angular velocity,rotational speed,rotation speed,rotary speed,velocity,"
    "vitesse,vitesse de rotation,vitesse angulaire",
    "pulley scheibe riemenscheibe motor poulie de la du the of ist actual act drive encoder",
)
_TORQUE: Final = _words(
    "drehmoment,moment,lastmoment,abtriebsmoment,bremsmoment,torque,couple,load torque",
    "abtrieb driven output nm n m shaft brake resistant de sortie last",
)
_DRIVER: Final = _words(
    "antriebsdrehzahl,eingangsdrehzahl,drehzahl antrieb,drehzahl an,antrieb,treibend,treibende,"
    "driver,driving,input,menante,motrice,entree",
    "drehzahl speed angular velocity rotational pulley scheibe der des vitesse de rotation "
    "angulaire poulie la shaft omega winkelgeschwindigkeit rpm ist n",
)
_DRIVEN: Final = _words(
    "abtriebsdrehzahl,ausgangsdrehzahl,drehzahl abtrieb,abtrieb,getrieben,getriebene,driven,output,"
    "menee,receptrice,sortie",
    " ".join(sorted(_DRIVER.fillers)),
)
_RUN: Final = _words(
    "run,lauf,versuch,messung,messreihe,essai,mesure,trial,test",
    "id no nr nummer number numero name label n num",
)

VOCABULARY: Final = {
    "run": _RUN,
    "time_s": _TIME,
    "tension_tight_N": _TIGHT,
    "tension_slack_N": _SLACK,
    "weight_N": _words(
        "weight,dead weight,hanging weight,gewicht,gewichtskraft,poids,totlast,load weight",
        "n force of the belt am de",
    ),
    "torque_N_m": _TORQUE,
    "hub_force_N": _words(
        "hub force,hub load,shaft load,shaft force,axle force,bearing force,wellenbelastung,"
        "achskraft,nabenkraft,lagerkraft,effort sur l axe",
        "n pulley radial belt riemen de la",
    ),
    "belt_speed_m_s": _words(
        "belt speed,belt velocity,riemengeschwindigkeit,bandgeschwindigkeit,vitesse courroie",
        "m s de la ist",
    ),
    "pulley_speed_rad_s": _SPEED,
    "temperature_degC": _TEMPERATURE,
    "arc_deg": _ARC,
    "initial_tension_N": _INITIAL,
    "idle": _words("idle,idling,leerlauf,a vide", "run"),
    "condition": _words("condition,surface,surface condition,zustand,oberflaeche,etat"),
    "side": _words("side,belt side,riemenseite", "belt"),
    "slip_speed_m_s": _words("slip speed,sliding speed,gleitgeschwindigkeit,slip velocity"),
    "mu": _words(
        "mu,cof,friction coefficient,coefficient of friction,reibungskoeffizient,reibzahl,"
        "reibbeiwert,coefficient de frottement",
        "sliding kinetic",
    ),
    "mu_se": _words("mu se,mu error,mu standard error,mu std"),
    "normal_force_N_m": _words("normal force,line force,normalkraft,streckenlast"),
    "test": _words(
        "test,versuch,pruefung,probe,specimen,sample,essai,eprouvette,probenkennung,"
        "probenname,specimen id,run",
        "id no nr nummer number numero name label n num",
    ),
    "displacement_mm": _words(
        "weg,standardweg,traversenweg,traverse,traversenposition,maschinenweg,kolbenweg,"
        "stempelweg,eindringweg,eindringtiefe,eindringung,verformung,stauchung,displacement,"
        "crosshead,travel,stroke,extension,compression,deformation,penetration,position,"
        "deplacement,course,deplacement traverse,enfoncement",
        "absolut absolute abs axial mm travel displacement position crosshead de la traverse "
        "machine 1 actuator piston sensor wegaufnehmer compressive standard",
    ),
    "force_N": _words(
        "kraft,standardkraft,pruefkraft,presskraft,druckkraft,normalkraft,stempelkraft,force,"
        "load,effort,charge,standard force,load cell,force normale,axialkraft",
        "n axial normal normale compressive compression press standard cell sensor "
        "kraftaufnehmer kmd 1 de la du machine kn",
    ),
    "driver_speed_rad_s": _DRIVER,
    "driven_speed_rad_s": _DRIVEN,
    "file": _words("file,filename,file name,datei,dateiname,fichier"),  # of a table of runs
}
"""Our column -> the names that mean it."""


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without unit, accents and signs."""
    bare = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", without_unit(name))
    low = bare.lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    words = " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain)))
    return _CHANNEL.sub("", words)


def roles_hinted(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns that a channel's name hints at: one of their words is part of it."""
    plain = simplified(name)
    return tuple(
        role
        for role, words in _words_of(kind)
        if any(len(key) >= _LEAST_HINT and _as_words(key).search(plain) for key in words.keys)
    )


def means_date(name: str) -> bool:
    """Return whether a channel's name says that it holds dates."""
    return _DATE.mean(simplified(name))


def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns of a kind of recording that a channel's name can mean."""
    plain = simplified(name)
    return tuple(role for role, words in _words_of(kind) if plain and words.mean(plain))


@functools.cache
def _words_of(kind: str) -> tuple[tuple[str, Words], ...]:
    """Return the columns of a kind of recording, or of a table of its runs, with their names."""
    columns = (*schemas.table(kind).names, "file")
    return tuple((role, words) for role, words in VOCABULARY.items() if role in columns)
