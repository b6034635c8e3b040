import { ActionIcon, Button, NativeSelect } from "@mantine/core";
import type { DragEvent } from "react";
import { TbArrowDown, TbArrowUp, TbCopy, TbGripVertical, TbPlus, TbRepeat, TbX } from "react-icons/tb";
import { short } from "../../samples/format";
import { type AngleUnit, formatWithUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { useRefusedInput, useRefusedWithin } from "../../service/forms/refusals";
import type { PartPlayed } from "../../wire/types";
import { ExpressionField } from "./CriteriaEditor";
import { innerOf, numberOf, type Part, type Place, type Value } from "./document";
import styles from "./SequenceEditor.module.css";
import { TEXTS } from "./texts";

interface Box {
  readonly name: string;
  readonly words: string;
  readonly unit: string;
  /** Whether the value may be omitted: the quantity then does not change, or has its default. */
  readonly optional?: boolean;
  readonly choices?: readonly string[];
}

interface PartForm {
  readonly words: string;
  readonly boxes: readonly Box[];
  /** Values of a new part. */
  readonly begins: Readonly<Record<string, Value | Part[]>>;
}

const box = (name: string, words: string, unit: string): Box => ({ name, words, unit });
const maybe = (name: string, words: string, unit: string): Box => ({ name, words, unit, optional: true });

const TIME = box("duration_s", TEXTS.time, "s");
const AIM = [maybe("q_ref", "q_ref", "rad"), maybe("S_ref", "S_ref", "N·m/rad")];
const PUSH = maybe("F_push", TEXTS.push, "N");
const AMPLITUDES = [
  maybe("q_amplitude", TEXTS.qAmplitude, "rad"),
  maybe("S_amplitude", TEXTS.SAmplitude, "N·m/rad"),
];

export const PART_FORMS: Readonly<Record<string, PartForm>> = {
  hold: { words: TEXTS.hold, boxes: [TIME], begins: { duration_s: 2 } },
  step: { words: TEXTS.step, boxes: [...AIM, TIME, PUSH], begins: { q_ref: 0, duration_s: 2 } },
  ramp: { words: TEXTS.ramp, boxes: [...AIM, TIME, PUSH], begins: { q_ref: 0, duration_s: 2 } },
  pulse: {
    words: TEXTS.pulse,
    boxes: [...AIM, TIME, box("rest_s", TEXTS.rest, "s")],
    begins: { q_ref: 0.2, duration_s: 2, rest_s: 2 },
  },
  sine: {
    words: TEXTS.sine,
    boxes: [
      ...AMPLITUDES,
      maybe("q_ref", TEXTS.qCrest, "rad"),
      maybe("S_ref", TEXTS.SCrest, "N·m/rad"),
      box("period_s", TEXTS.period, "s"),
      TIME,
      PUSH,
    ],
    begins: { q_amplitude: 0.2, period_s: 4, duration_s: 8 },
  },
  sweep: {
    words: TEXTS.sweep,
    boxes: [...AMPLITUDES, box("from_Hz", TEXTS.from, "Hz"), box("to_Hz", TEXTS.to, "Hz"), TIME],
    begins: { q_amplitude: 0.05, from_Hz: 0.1, to_Hz: 1, duration_s: 20 },
  },
  prbs: {
    words: TEXTS.prbs,
    boxes: [
      ...AMPLITUDES,
      box("chip_s", TEXTS.chip, "s"),
      box("bits", TEXTS.bits, "1"),
      maybe("periods", TEXTS.periods, "1"),
    ],
    begins: { q_amplitude: 0.05, chip_s: 0.2, bits: 6 },
  },
  multisine: {
    words: TEXTS.multisine,
    boxes: [
      ...AMPLITUDES,
      box("period_s", TEXTS.period, "s"),
      box("lines", TEXTS.lines, "1"),
      maybe("periods", TEXTS.periods, "1"),
    ],
    begins: { q_amplitude: 0.05, period_s: 8, lines: 10 },
  },
  push: {
    words: TEXTS.push,
    boxes: [
      box("F_push", TEXTS.force, "N"),
      TIME,
      { name: "shape", words: TEXTS.shape, unit: "1", choices: ["step", "ramp", "smooth"] },
    ],
    begins: { F_push: 5, duration_s: 2, shape: "step" },
  },
  hand: {
    words: TEXTS.manualPush,
    boxes: [
      box("F_push", TEXTS.force, "N"),
      box("pushes", TEXTS.pushes, "1"),
      box("pause_s", TEXTS.pause, "s"),
      maybe("seed", TEXTS.seed, "1"),
    ],
    begins: { F_push: 5, pushes: 3, pause_s: 2 },
  },
  load: {
    words: TEXTS.shaftLoad,
    boxes: [maybe("load_A", TEXTS.loadA, "N·m"), maybe("load_B", TEXTS.loadB, "N·m"), TIME],
    begins: { load_A: 0.05, duration_s: 2 },
  },
  wall: {
    words: TEXTS.wall,
    boxes: [
      box("q_wall", "q_wall", "rad"),
      { name: "side", words: TEXTS.wallSide, unit: "1", choices: ["above", "below"] },
      maybe("k_wall", TEXTS.stiffness, "N/m"),
      maybe("c_wall", TEXTS.damping, "s/m"),
    ],
    begins: { q_wall: 0.5, side: "above" },
  },
  no_wall: { words: TEXTS.removeWall, boxes: [], begins: {} },
  tuning: {
    words: TEXTS.tuning,
    boxes: [
      maybe("lam_q", "λ_q", "s"),
      maybe("lam_S", "λ_S", "s"),
      maybe("lam_motor", "λ_motor", "s"),
      maybe("b", "b", "1"),
      maybe("bank", TEXTS.bankOfTuning, "1"),
      { name: "motion", words: TEXTS.motion, unit: "1", choices: ["lambda", "time-optimal"], optional: true },
      maybe("u_plan", TEXTS.voltageLimit, "V"),
      maybe("k_ext", "k_ext", "1"),
    ],
    begins: { lam_q: 0.8 },
  },
  learn: { words: TEXTS.calibrate, boxes: [maybe("duration_s", TEXTS.time, "s")], begins: { duration_s: 2 } },
  until_contact: {
    words: TEXTS.untilContact,
    boxes: [maybe("contact_N", TEXTS.contactForce, "N")],
    begins: { contact_N: 1.5, parts: [{ do: "hold", duration_s: 2 }] },
  },
  repeat: {
    words: TEXTS.repeat,
    boxes: [box("times", TEXTS.repetitions, "1")],
    begins: { times: 2, parts: [{ do: "hold", duration_s: 2 }] },
  },
};

/** Creates a part of a kind; it takes over the common values of `other`, so a step becomes a ramp to the same target. */
export function partOf(kind: string, other?: Part): Part {
  const form = PART_FORMS[kind];
  const common = Object.fromEntries(
    Object.entries(other ?? {}).filter(
      ([name]) =>
        name !== "do" &&
        form?.boxes.some((one) => one.name === name) &&
        // the target of another motion is no crest of a sine
        !(kind === "sine" && other?.do !== "sine" && AIM.some((one) => one.name === name)),
    ),
  );
  const begins = form?.begins ?? {};
  const inner = other === undefined ? undefined : innerOf(other)[0]?.[1];
  const parts = "parts" in begins && inner !== undefined ? { parts: [...inner] } : {};
  // a reference that `other` does not move stays unmoved
  const aims = "q_ref" in common || "S_ref" in common ? { ...begins, q_ref: undefined } : begins;
  // a sine from another kind of part is one period with the duration of that part
  const period =
    kind === "sine" && !("period_s" in common) && "duration_s" in common
      ? { period_s: common.duration_s }
      : {};
  return stripped({ do: kind, ...aims, ...common, ...period, ...parts });
}

/** Returns a part without undefined values. */
function stripped(part: Part): Part {
  return Object.fromEntries(Object.entries(part).filter(([, value]) => value !== undefined)) as Part;
}

/** Formats a number with its unit, or returns an expression as written; null for an omitted value. */
function formatValue(part: Part, name: string, unit: string, angles: AngleUnit): string | null {
  const value = part[name];
  if (typeof value === "number") return formatWithUnit(value, unit, angles);
  return typeof value === "string" ? value : null;
}

function aim(part: Part, angles: AngleUnit): string {
  const q = formatValue(part, "q_ref", "rad", angles);
  const S = formatValue(part, "S_ref", "N·m/rad", angles);
  const named = [
    q === null ? null : fillText(TEXTS.referenceTo, { symbol: "q", value: q }),
    S === null ? null : fillText(TEXTS.referenceTo, { symbol: "S", value: S }),
  ].filter((one) => one !== null);
  return named.length === 0 ? TEXTS.noReference : named.join(", ");
}

function swing(part: Part, angles: AngleUnit): string {
  const q = part.q_amplitude === 0 ? null : formatValue(part, "q_amplitude", "rad", angles);
  const S = part.S_amplitude === 0 ? null : formatValue(part, "S_amplitude", "N·m/rad", angles);
  const q_crest = formatValue(part, "q_ref", "rad", angles);
  const S_crest = formatValue(part, "S_ref", "N·m/rad", angles);
  const named = [oscillation("q", q, q_crest), oscillation("S", S, S_crest)].filter((one) => one !== null);
  return named.length === 0 ? TEXTS.noReference : named.join(", ");
}

/** Describes the amplitude and crest of q or S; null without either. */
function oscillation(symbol: string, amplitude: string | null, crest: string | null): string | null {
  const values = [
    amplitude === null ? null : fillText(TEXTS.amplitude, { value: amplitude }),
    crest === null ? null : fillText(TEXTS.crest, { value: crest }),
  ].filter((one) => one !== null);
  return values.length === 0 ? null : fillText(TEXTS.oscillation, { symbol, values: values.join(", ") });
}

/** Describes the push during a motion; "" without one. */
function push(part: Part, angles: AngleUnit): string {
  const force = part.F_push === 0 ? null : formatValue(part, "F_push", "N", angles);
  return force === null ? "" : fillText(TEXTS.withPush, { force });
}

/** Describes a part from its values. */
export function describePart(part: Part, angles: AngleUnit): string {
  const time = formatValue(part, "duration_s", "s", angles) ?? "";
  const of = (name: string, unit: string) => formatValue(part, name, unit, angles) ?? TEXTS.missing;
  switch (part.do) {
    case "hold":
      return fillText(TEXTS.describeHold, { time });
    case "step":
      return fillText(TEXTS.describeStep, {
        references: aim(part, angles),
        time,
        push: push(part, angles),
      });
    case "ramp":
      return fillText(TEXTS.describeRamp, {
        references: aim(part, angles),
        time,
        push: push(part, angles),
      });
    case "pulse":
      return fillText(TEXTS.describePulse, {
        references: aim(part, angles),
        time,
        rest: of("rest_s", "s"),
      });
    case "sine":
      return fillText(TEXTS.describeSine, {
        oscillations: swing(part, angles),
        period: of("period_s", "s"),
        time,
        cycles: cycles(part),
        speed: fastest(part, angles),
        push: push(part, angles),
      });
    case "sweep":
      return fillText(TEXTS.describeSweep, {
        oscillations: swing(part, angles),
        from: of("from_Hz", "Hz"),
        to: of("to_Hz", "Hz"),
        time,
      });
    case "prbs":
      return fillText(TEXTS.describePrbs, {
        oscillations: swing(part, angles),
        bits: of("bits", "1"),
        chip: of("chip_s", "s"),
      });
    case "multisine":
      return fillText(TEXTS.describeMultisine, {
        oscillations: swing(part, angles),
        lines: of("lines", "1"),
        period: of("period_s", "s"),
      });
    case "push":
      return fillText(TEXTS.describePush, { force: of("F_push", "N"), time });
    case "hand":
      return fillText(TEXTS.describeManualPush, { pushes: of("pushes", "1"), force: of("F_push", "N") });
    case "load":
      return fillText(TEXTS.describeShaftLoad, { time });
    case "wall":
      return fillText(part.side === "below" ? TEXTS.describeWallBelow : TEXTS.describeWallAbove, {
        angle: of("q_wall", "rad"),
      });
    case "no_wall":
      return TEXTS.describeRemoveWall;
    case "tuning":
      return tuning(part, angles);
    case "learn":
      return fillText(TEXTS.describeCalibrate, { time: time || TEXTS.usualCalibration });
    case "until_contact":
      return fillText(TEXTS.describeUntilContact, {
        force: formatValue(part, "contact_N", "N", angles) ?? TEXTS.usualContact,
      });
    case "repeat":
      return fillText(TEXTS.describeRepeat, {
        times: of("times", "1"),
        index: String(part.index ?? TEXTS.usualIndex),
      });
    case "choose":
      return fillText(TEXTS.describeChoose, { setting: String(part.by) });
    default:
      return TEXTS.describeUnknown;
  }
}

function cycles({ duration_s, period_s }: Part): string {
  if (typeof duration_s !== "number" || typeof period_s !== "number" || period_s <= 0) return "";
  const count = Number((duration_s / period_s).toPrecision(3));
  return fillText(TEXTS.cycles, {
    cycles: count === 1 ? TEXTS.cycle : fillText(TEXTS.cycleCount, { count: short(count) }),
  });
}

/** Describes the largest rate of a sine of q, a·2π/T. */
function fastest({ q_amplitude, period_s }: Part, angles: AngleUnit): string {
  if (typeof q_amplitude !== "number" || typeof period_s !== "number" || period_s <= 0 || q_amplitude === 0)
    return "";
  const speed = rate((Math.abs(q_amplitude) * 2 * Math.PI) / period_s, "rad/s", angles);
  return fillText(TEXTS.speed, { speed });
}

function tuning(part: Part, angles: AngleUnit): string {
  const named = Object.entries(part).filter(([name]) => name !== "do");
  const words: Record<string, string> = {
    lam_q: "λ_q",
    lam_S: "λ_S",
    lam_motor: "λ_motor",
    u_plan: "U_plan",
  };
  const units: Record<string, string> = { lam_q: "s", lam_S: "s", lam_motor: "s", u_plan: "V" };
  const parts = named.map(([name, value]) => {
    const shown =
      typeof value === "boolean"
        ? value
          ? TEXTS.yes
          : TEXTS.no
        : formatValue(part, name, units[name] ?? "1", angles);
    return fillText(TEXTS.tuningValue, { symbol: words[name] ?? name, value: String(shown) });
  });
  return parts.length === 0
    ? TEXTS.describeSameTuning
    : fillText(TEXTS.describeTuning, { changes: parts.join(", ") });
}

/** Describes the schedule of a part, and the speed of a ramp, as the service computed them. */
export function describePlayed(part: Part, played: PartPlayed, angles: AngleUnit): string {
  const words = [
    fillText(TEXTS.scheduled, {
      start: short(played.start_s),
      end: formatWithUnit(played.end_s, "s", angles),
    }),
  ];
  if (part.do === "ramp" && played.piece_s > 0) {
    for (const [name, from, to, unit] of [
      ["q", played.q_from, played.q_to, "rad"],
      ["S", played.S_from, played.S_to, "N·m/rad"],
    ] as const) {
      if (from === null || from === to) continue;
      const speed = rate((to - from) / played.piece_s, unit === "rad" ? "rad/s" : "N·m/rad/s", angles);
      words.push(
        fillText(TEXTS.startsFrom, { symbol: name, value: formatWithUnit(from, unit, angles), speed }),
      );
    }
  }
  return words.join(", ");
}

function rate(value: number, unit: string, angles: AngleUnit): string {
  return formatWithUnit(Number(value.toPrecision(3)), unit, angles).replace(
    /^(−?)(\d+\.?\d*)/,
    (_, sign, number) => `${sign}${short(Number(number), 3)}`,
  );
}

/** Actions that a row requests from its editor. */
export interface Composing {
  /** Schedule by place; empty while the schedule belongs to another text. */
  readonly played: ReadonlyMap<string, PartPlayed>;
  replace(place: Place, part: Part): void;
  insert(place: Place, part: Part): void;
  remove(place: Place): void;
  /** Moves a part by one place, into and out of loops; the pressed button keeps the focus. */
  shift(place: Place, by: -1 | 1): void;
  canShift(place: Place, by: -1 | 1): boolean;
  drag(from: Place, event: DragEvent): void;
  drop(before: Place): void;
}

interface PartListProps {
  readonly place: Place;
  readonly parts: readonly Part[];
  readonly composing: Composing;
}

/** Lists parts with their boxes, descriptions and buttons, and a target to drop or add a part at the end. */
export function PartList({ place, parts, composing }: PartListProps) {
  const end = [...place, parts.length];
  return (
    <ol className={styles.list}>
      {parts.map((part, index) => (
        <PartRow
          // biome-ignore lint/suspicious/noArrayIndexKey: a part is identified by its position in the sequence
          key={index}
          part={part}
          place={[...place, index]}
          alone={parts.length === 1}
          composing={composing}
        />
      ))}
      <li
        className={styles.end}
        onDragOver={(event) => {
          event.preventDefault();
          event.stopPropagation();
        }}
        onDrop={(event) => {
          event.preventDefault();
          event.stopPropagation();
          composing.drop(end);
        }}
      >
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          aria-label={fillText(TEXTS.addPartAt, { number: numberOf(end) })}
          onClick={() => composing.insert(end, parts.at(-1) ?? partOf("hold"))}
        >
          {TEXTS.addPart}
        </Button>
      </li>
    </ol>
  );
}

interface PartRowProps {
  readonly part: Part;
  readonly place: Place;
  readonly alone: boolean;
  readonly composing: Composing;
}

function PartRow({ part, place, alone, composing }: PartRowProps) {
  const angles = useAngleUnit();
  const key = place.join(".");
  const number = numberOf(place);
  const whose = fillText(TEXTS.ofPart, { number });
  const messageId = `refused-${key.replaceAll(".", "-")}`;
  const form = PART_FORMS[part.do];
  const kinds = Object.entries(PART_FORMS).map(([value, { words }]) => ({ value, label: words }));
  const { ref, said } = useRefusedInput<HTMLSelectElement>(key, messageId);
  const set = (name: string, value: unknown) =>
    composing.replace(place, stripped({ ...part, [name]: value } as Part));
  const played = composing.played.get(key);
  return (
    <li
      className={styles.part}
      data-place={key}
      aria-label={fillText(TEXTS.part, { number })}
      onDragOver={(event) => {
        event.preventDefault();
        event.stopPropagation();
      }}
      onDrop={(event) => {
        event.preventDefault();
        event.stopPropagation();
        composing.drop(place);
      }}
    >
      <div className={styles.head}>
        {/* biome-ignore lint/a11y/noStaticElementInteractions: the adjacent buttons offer the same actions by keyboard */}
        <span
          className={styles.grip}
          draggable
          title={TEXTS.dragPart}
          onDragStart={(event) => composing.drag(place, event)}
        >
          <TbGripVertical size={14} aria-hidden />
          {number}
        </span>
        <NativeSelect
          ref={ref}
          size="xs"
          aria-label={fillText(TEXTS.kindOfPart, { number })}
          error={said !== null}
          data={form === undefined ? [{ value: part.do, label: part.do }, ...kinds] : kinds}
          value={part.do}
          onChange={(event) => composing.replace(place, partOf(event.currentTarget.value, part))}
        />
        <span className={styles.words}>
          {describePart(part, angles)}
          {played && <span className={styles.played}> {describePlayed(part, played, angles)}</span>}
        </span>
        <span className={styles.buttons}>
          <RowButton
            words={fillText(TEXTS.movePartUp, { number })}
            name="up"
            off={!composing.canShift(place, -1)}
            onClick={() => composing.shift(place, -1)}
          >
            <TbArrowUp size={14} />
          </RowButton>
          <RowButton
            words={fillText(TEXTS.movePartDown, { number })}
            name="down"
            off={!composing.canShift(place, 1)}
            onClick={() => composing.shift(place, 1)}
          >
            <TbArrowDown size={14} />
          </RowButton>
          <RowButton
            words={fillText(TEXTS.repeatPart, { number })}
            name="repeat"
            onClick={() => composing.replace(place, { do: "repeat", times: 2, parts: [part] })}
          >
            <TbRepeat size={14} />
          </RowButton>
          <RowButton
            words={fillText(TEXTS.copyPart, { number })}
            name="copy"
            onClick={() => composing.insert(place, part)}
          >
            <TbCopy size={14} />
          </RowButton>
          <RowButton
            words={fillText(TEXTS.removePart, { number })}
            name="remove"
            off={alone}
            onClick={() => composing.remove(place)}
          >
            <TbX size={14} />
          </RowButton>
        </span>
      </div>
      {form !== undefined && form.boxes.length > 0 && (
        <div className={styles.boxes}>
          {form.boxes.map(({ name, words, unit, optional, choices }) =>
            choices === undefined ? (
              <ExpressionField
                key={name}
                words={words}
                unit={unit}
                whose={whose}
                optional={optional}
                value={part[name] as number | string | undefined}
                place={`${key}.${name}`}
                messageId={messageId}
                onChange={(value) => set(name, value)}
              />
            ) : (
              <NativeSelect
                key={name}
                size="xs"
                label={words}
                aria-label={fillText(TEXTS.labelOf, { label: words, owner: whose })}
                data={optional ? [{ value: "", label: TEXTS.unchanged }, ...choices] : [...choices]}
                value={String(part[name] ?? (optional ? "" : choices[0]))}
                onChange={(event) => set(name, event.currentTarget.value || undefined)}
              />
            ),
          )}
        </div>
      )}
      <RowRefusal
        at={key}
        inner={innerOf(part).map(([inner]) => `${key}.${inner.join(".")}`)}
        id={messageId}
        reason={said}
      />
      {innerOf(part).map(([inner, parts]) => (
        <PartList key={inner.join(".")} place={[...place, ...inner]} parts={parts} composing={composing} />
      ))}
    </li>
  );
}

interface RowRefusalProps {
  readonly at: string;
  /** Places of the inner parts, which show their own refusals. */
  readonly inner: readonly string[];
  readonly id: string;
  readonly reason: string | null;
}

/** Shows a refusal below the row, because the boxes are too narrow for a sentence. */
function RowRefusal({ at, inner, id, reason }: RowRefusalProps) {
  const within = useRefusedWithin(at, inner);
  const text = reason ?? within;
  return text === null ? null : (
    <div id={id} role="alert" className={styles.refused}>
      {text}
    </div>
  );
}

interface RowButtonProps {
  readonly words: string;
  readonly name: string;
  readonly off?: boolean;
  readonly children: React.ReactNode;
  onClick(): void;
}

function RowButton({ words, name, off = false, children, onClick }: RowButtonProps) {
  return (
    <ActionIcon
      size={24}
      variant="subtle"
      color="gray"
      aria-label={words}
      title={words}
      data-button={name}
      aria-disabled={off}
      data-disabled={off || undefined}
      onClick={() => !off && onClick()}
    >
      {children}
    </ActionIcon>
  );
}
