"""The schematic of the sensor head, for people. Values and nets are those of sensor-head.py."""

import schemdraw
import schemdraw.elements as elm
from schemdraw import logic

schemdraw.use("svg")


def draw(value, net, number):
    """The SVG. `value` gives a part's value by its name, `net` a pin's net, `number` its number."""
    d = schemdraw.Drawing(show=False, fontsize=11, unit=2.2, lw=1.5)
    d.config(bgcolor="white")

    def named(element, ref):
        return element.label(f"{ref} {value(ref)}", fontsize=10)

    def tag(part, pin, at, side):
        """The name of the net at a pin."""
        d.add(elm.Dot(open=True).at(at))
        align = ("right", "center") if side == "left" else ("left", "center")
        shift = -0.2 if side == "left" else 0.2
        d.add(
            elm.Label()
            .at((at[0] + shift, at[1]))
            .label(net(part, pin), halign=align[0], valign="center", color="#1f77b4")
        )

    def title(text, at):
        d.add(elm.Label().at(at).label(text, halign="left", fontsize=13))

    def chip(ref, at, left, right, width, step=0.9):
        pins = [elm.IcPin(name=name, pin=str(number), side="left") for name, number in reversed(left)]
        pins += [elm.IcPin(name=name, pin=str(number), side="right") for name, number in reversed(right)]
        height = step * max(len(left), len(right)) + 0.5
        made = d.add(
            elm.Ic(pins=pins, size=(width, height), pinspacing=step, leadlen=0.6)
            .at(at)
            .anchor("center")
            .theta(0)
        )
        d.add(elm.Label().at((at[0], at[1] + height / 2 + 0.35)).label(f"{ref} {value(ref)}", fontsize=11))
        return made

    # The clocks: buffer, series resistors, sensor.
    title("clocks: 3.3 V to 5 V", (0, 12.2))
    for i, (gate, ref, pin) in enumerate((("1", "R1", "FM"), ("2", "R2", "ICG"), ("3", "R3", "SH"))):
        y = 10.8 - 1.6 * i
        tag("U2", f"{gate}A", (1.6, y), "left")
        d.add(elm.Line().at((1.6, y)).to((2.2, y)))
        buffer = d.add(logic.Buf().at((2.2, y)).right())
        pins = f"U2 {number('U2', gate + 'A')} to {number('U2', gate + 'Y')}"
        d.add(elm.Label().at((2.9, y + 0.75)).label(pins, fontsize=9))
        resistor = d.add(named(elm.Resistor().at(buffer.end).right().length(2.4), ref))
        tag("U1", pin, (resistor.end[0] + 0.0, y), "right")
    d.add(
        elm.Label()
        .at((0.2, 6.3))
        .label(
            f"{value('U2')}: 14 at {net('U2', 'VCC')}; 7, 1, 4, 10 (enable), 12 at {net('U2', 'GND')}; "
            f"13 at {net('U2', '4OE')}",
            halign="left",
            fontsize=9,
        )
    )

    # The sensor.
    sensor = chip(
        "U1",
        (13.4, 9.4),
        [("FM", 4), ("ICG", 3), ("SH", 5), ("VDD", 1), ("VAD", 2)],
        [("OS", 21), ("SS", 22)],
        2.4,
    )
    for pin in ("FM", "ICG", "SH", "VDD", "VAD"):
        tag("U1", pin, getattr(sensor, pin), "left")
    for pin in ("OS", "SS"):
        tag("U1", pin, getattr(sensor, pin), "right")

    # The amplifier.
    title("amplifier: gain of 5 about the offset", (0, 5.2))

    def pins_of(half):
        ends = ", ".join(number("U3", pin) for pin in (f"IN{half}+", f"IN{half}-"))
        return f"U3\n{ends} to {number('U3', 'OUT' + half)}"

    gain = d.add(elm.Opamp(leads=True).at((9.0, 2.6)).anchor("out").right().flip())
    d.add(elm.Label().at((gain.center[0] - 0.1, gain.center[1])).label(pins_of("1"), fontsize=8))
    d.add(elm.Line().at(gain.in2).left().length(0.8))
    tag("U3", "IN1+", (gain.in2[0] - 0.8, gain.in2[1]), "left")
    joint = (gain.in1[0] - 0.5, gain.in1[1])
    d.add(elm.Line().at(gain.in1).to(joint))
    d.add(elm.Dot().at(joint))
    below = (joint[0], joint[1] - 1.5)
    d.add(elm.Line().at(joint).to(below))
    feedback = d.add(named(elm.Resistor().at(below).right().tox(gain.out), "R4"))
    d.add(elm.Line().at(feedback.end).to(gain.out))
    d.add(elm.Dot().at(gain.out))
    follower = d.add(elm.Opamp(leads=True).at((3.6, joint[1] - 0.0)).anchor("out").right().flip())
    d.add(elm.Label().at((follower.center[0] - 0.1, follower.center[1])).label(pins_of("2"), fontsize=8))
    d.add(named(elm.Resistor().at(follower.out).right().tox(joint), "R5"))
    d.add(elm.Dot().at(follower.out))
    loop = follower.in1[1] - 0.9
    d.add(elm.Line().at(follower.in1).to((follower.in1[0], loop)))
    d.add(elm.Line().at((follower.in1[0], loop)).to((follower.out[0], loop)))
    d.add(elm.Line().at((follower.out[0], loop)).to(follower.out))
    for pin, at in (
        ("OUT2", (follower.out[0] + 0.15, loop - 0.1)),
        ("IN1-", (joint[0] + 0.15, joint[1] - 0.8)),
        ("OUT1", (gain.out[0] + 0.15, below[1])),
    ):
        d.add(elm.Label().at(at).label(net("U3", pin), color="#1f77b4", halign="left"))
    tag("U3", "IN2+", follower.in2, "left")
    # To the converter.
    after = d.add(named(elm.Resistor().at(gain.out).right().length(2.4), "R8"))
    d.add(elm.Dot().at(after.end))
    store = d.add(
        elm.Capacitor().at(after.end).down().length(1.8).label(f"C2\n{value('C2')}", loc="top", fontsize=10)
    )
    d.add(elm.Ground().at(store.end))
    node = (after.end[0] + 1.3, after.end[1])
    d.add(elm.Line().at(after.end).to(node))
    tag("U4", "IN1", node, "right")
    supply = f"{value('U3')}: 8 at {net('U3', 'V+')}, 4 at {net('U3', 'V-')}"
    d.add(elm.Label().at((9.6, 4.3)).label(supply, halign="left", fontsize=9))

    # The converter.
    adc = chip(
        "U4",
        (19.6, 9.4),
        [("IN1", 5), ("IN2", 4), ("VA", 2), ("GND", 3)],
        [("CS", 1), ("SCLK", 8), ("DOUT", 7), ("DIN", 6)],
        2.6,
    )
    for pin in ("IN1", "IN2", "VA", "GND"):
        tag("U4", pin, getattr(adc, pin), "left")
    for pin in ("CS", "SCLK", "DOUT", "DIN"):
        tag("U4", pin, getattr(adc, pin), "right")

    def chain(at, start, refs, end, text=None):
        """Parts in a line between two nets."""
        tag(*start, at, "left")
        place = at
        for ref in refs:
            kind = {"R": elm.Resistor, "F": elm.Inductor2, "C": elm.Capacitor}[ref[0]]
            place = d.add(named(kind().at(place).right().length(2.2), ref)).end
        tag(*end, (place[0], place[1]), "right")

    title("SCLK, pull-ups, laser", (17.4, 5.2))
    chain((18.6, 4.2), ("J1", "PA5"), ["R9"], ("U4", "SCLK"))
    chain((18.6, 3.0), ("U4", "SCLK"), ["R10"], ("J1", "3V3"))
    chain((18.6, 1.8), ("U4", "CS"), ["R11"], ("J1", "3V3"))
    chain((18.6, 0.6), ("J1", "PD15"), ["R12"], ("J2", "TTL"))
    chain((18.6, -0.6), ("J2", "TTL"), ["R13"], ("J2", "GND"))

    title("offset", (0, -1.6))
    tag("R6", "1", (1.6, -2.6), "left")
    upper = d.add(named(elm.Resistor().at((1.6, -2.6)).right().length(2.2), "R6"))
    trimmer = d.add(
        elm.Potentiometer()
        .at(upper.end)
        .right()
        .length(2.2)
        .label(f"RV1 {value('RV1')}", loc="bottom", ofst=0.35, fontsize=10)
    )
    tag("RV1", "WIPER", trimmer.tap, "right")
    d.add(named(elm.Resistor().at(trimmer.end).right().length(2.2), "R7"))
    tag("R7", "2", (trimmer.end[0] + 2.2, -2.6), "right")
    chain((1.6, -4.2), ("RV1", "WIPER"), ["C1"], ("C1", "2"))
    title("supplies", (11.8, -1.6))
    chain((13.4, -2.6), ("J1", "5V"), ["FB1"], ("U1", "VDD"))
    chain((13.4, -4.2), ("J1", "5V"), ["FB2"], ("J2", "+5V"))
    regulator = chip("U5", (20.6, -3.5), [("IN", 1), ("EN", 3)], [("OUT", 5), ("GND", 2)], 2.0)
    for pin in ("IN", "EN"):
        tag("U5", pin, getattr(regulator, pin), "left")
    for pin in ("OUT", "GND"):
        tag("U5", pin, getattr(regulator, pin), "right")
    capacitors = [f"C{i}" for i in range(3, 11)] + [f"R{i}" for i in range(14, 17)]
    for line, refs in enumerate((capacitors[:4], capacitors[4:8], capacitors[8:])):
        text = "; ".join(f"{ref} {value(ref)} from {net(ref, '1')} to {net(ref, '2')}" for ref in refs)
        d.add(elm.Label().at((0.2, -5.4 - 0.6 * line)).label(text, halign="left", fontsize=9))
    return d.get_imagedata("svg").decode()
