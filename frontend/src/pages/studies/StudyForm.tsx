import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { TbPlus, TbX } from "react-icons/tb";
import { NumberField } from "../../components/fields";
import { boxText, inSI, labelWith, offeredDefault } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { experimentKindsQuery } from "../../service/api/experiments";
import { useAngleUnit } from "../../service/api/preferences";
import { plantNumbersQuery } from "../../service/api/studies";
import { isOfTheLoop } from "../experiments/ExperimentForm";
import pageStyles from "../Page.module.css";
import studyFormStyles from "./StudyForm.module.css";
import { TEXTS } from "./texts";

/** Parameters that a study can vary: settings of the experiment and the loop, and plant parameters. */

interface Varied {
  readonly name: string;
  readonly label: string;
  readonly unit: string;
  /** Initial value of a new axis or setting. */
  readonly value: boolean | number | string;
}

interface Choices {
  readonly experiment: readonly Varied[];
  readonly loop: readonly Varied[];
  readonly plant: readonly Varied[];
}

/** Returns the parameters of an experiment; for an unknown one, only those of loop and plant. */
function useVaried(experiment: string): Choices {
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const { data: numbers = [] } = useQuery(plantNumbersQuery);
  const angles = useAngleUnit();
  const kind = kinds.find(({ name }) => name === experiment) ?? null;
  const settings = (kind ?? kinds[0])?.settings ?? [];
  const shown = settings.map((setting) => ({
    loop: isOfTheLoop(setting),
    name: setting.name,
    label: `${setting.symbol}: ${setting.meaning}`,
    unit: setting.unit,
    value: offeredDefault(setting.default ?? "", setting, angles),
  }));
  return {
    experiment: kind === null ? [] : shown.filter(({ loop }) => !loop),
    loop: shown.filter(({ loop }) => loop),
    plant: numbers.map(({ name, unit, value }) => ({ name, label: name, unit, value })),
  };
}

/** Returns a parameter by name; an unknown name becomes a dimensionless parameter. */
function variedOf(choices: Choices, name: string): Varied {
  const all = [...choices.experiment, ...choices.loop, ...choices.plant];
  return all.find((one) => one.name === name) ?? { name, label: name, unit: "1", value: 0 };
}

/** Returns the parameters as groups of a select, including the current value if it is none of them. */
function groupsOf(choices: Choices, current: string, only: readonly (keyof Choices)[]) {
  const titles = { experiment: TEXTS.ofExperiment, loop: TEXTS.ofLoop, plant: TEXTS.ofPlant };
  const groups = only.map((key) => ({
    group: titles[key],
    items: choices[key].map(({ name, label }) => ({ value: name, label })),
  }));
  const known = groups.some(({ items }) => items.some(({ value }) => value === current));
  return known ? groups : [{ group: TEXTS.fromText, items: [{ value: current, label: current }] }, ...groups];
}

/** Select of a parameter by symbol and meaning, on its own line because meanings are long. */

interface VariedSelectProps {
  readonly label: string;
  readonly value: string;
  readonly choices: Choices;
  readonly only: readonly (keyof Choices)[];
  onChange(name: string): void;
}

function VariedSelect({ label, value, choices, only, onChange }: VariedSelectProps) {
  return (
    <NativeSelect
      aria-label={label}
      title={variedOf(choices, value).label}
      style={{ flex: "1 0 100%" }}
      data={groupsOf(choices, value, only)}
      value={value}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Document of a study, which the form edits, and its conversion to YAML. Pure. */

type Value = boolean | number | string;

/** Axis over `values`, or `count` values from `first` to `last`. A box can hold an incomplete number. */
interface Axis {
  readonly over: string;
  readonly values?: readonly Value[];
  readonly first?: Value;
  readonly last?: Value;
  readonly count?: Value;
  readonly spacing?: string;
}

/** Random spread of a plant parameter. */
interface Spread {
  readonly of: string;
  readonly by?: string;
  readonly relative?: Value;
  readonly absolute?: Value;
}

export interface StudyDocument {
  readonly name: string;
  readonly title: string;
  readonly experiment?: string;
  readonly settings?: Readonly<Record<string, Value>>;
  readonly axes?: readonly Axis[];
  readonly spread?: readonly Spread[];
  readonly draws?: Value;
  readonly seeds?: Value;
  readonly seed?: Value;
  readonly [other: string]: unknown;
}

export const EMPTY_STUDY: StudyDocument = {
  format: 1,
  name: "mine",
  title: TEXTS.newTitle,
  experiment: "tracking",
  settings: { motion: "lambda" },
  axes: [{ over: "lam_q", first: 0.4, last: 1, count: 5 }],
};

/** Returns the document if the form can show it, else null; the service checks everything else. */
export function asStudy(read: unknown): StudyDocument | null {
  if (typeof read !== "object" || read === null || Array.isArray(read)) return null;
  const { axes = [], spread = [], settings = {}, name = "", title = "" } = read as Record<string, unknown>;
  const isShown =
    typeof name === "string" &&
    typeof title === "string" &&
    isRecord(settings) &&
    Array.isArray(axes) &&
    axes.every((axis) => isRecord(axis) && (axis.values === undefined || Array.isArray(axis.values))) &&
    Array.isArray(spread) &&
    spread.every(isRecord);
  return isShown ? (read as StudyDocument) : null;
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** Returns the document as YAML, one line per axis and spread, without undefined values and empty lists. */
export function writeStudy(document: StudyDocument): string {
  const lines = Object.entries(document).flatMap(([name, value]) => {
    if (value === undefined || (Array.isArray(value) && value.length === 0)) return [];
    if ((name === "axes" || name === "spread") && Array.isArray(value)) {
      return [`${name}:`, ...value.map((one) => `  - ${flow(one)}`)];
    }
    return [`${name}: ${flow(value)}`];
  });
  return `${lines.join("\n")}\n`;
}

const PLAIN = /^[A-Za-z][A-Za-z0-9_.@]*$/;
const WORDS = new Set(["true", "false", "null"]);

/** Returns a value as one line of YAML; quotes strings that YAML could read as another type. */
function flow(value: unknown): string {
  if (typeof value === "string") {
    return PLAIN.test(value) && !WORDS.has(value) ? value : JSON.stringify(value);
  }
  if (Array.isArray(value)) return `[${value.map(flow).join(", ")}]`;
  if (isRecord(value)) {
    const entries = Object.entries(value).filter(([, one]) => one !== undefined);
    return `{${entries.map(([name, one]) => `${flow(name)}: ${flow(one)}`).join(", ")}}`;
  }
  return JSON.stringify(value);
}

/** Reads a list of values: numbers in SI, true and false, and other words unchanged. */
export function valuesIn(text: string, inSI: (word: string) => number | null): Value[] {
  return text
    .split(/[,;\s]+/)
    .filter((word) => word !== "")
    .map((word) => (word === "true" ? true : word === "false" ? false : (inSI(word) ?? word)));
}

/** Fields of the axes of a study, each with a range or a list of values. */

interface AxisRowsProps {
  readonly axes: readonly Axis[];
  readonly choices: Choices;
  onChange(axes: readonly Axis[]): void;
}

function AxisRows({ axes, choices, onChange }: AxisRowsProps) {
  return (
    <fieldset className={`${studyFormStyles.group} ${pageStyles.fields}`}>
      <legend>{TEXTS.axes}</legend>
      {axes.map((axis, index) => (
        <Row
          // biome-ignore lint/suspicious/noArrayIndexKey: an axis has no identity except its index
          key={index}
          number={index + 1}
          axis={axis}
          choices={choices}
          onChange={(next) => onChange(axes.with(index, next))}
          onRemove={() => onChange(axes.toSpliced(index, 1))}
        />
      ))}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          onClick={() => onChange([...axes, newAxis(axes)])}
        >
          {TEXTS.addAxis}
        </Button>
      </div>
    </fieldset>
  );
}

function newAxis(axes: readonly Axis[]): Axis {
  const taken = new Set(axes.map(({ over }) => over));
  const over = ["lam_q", "lam_S"].find((name) => !taken.has(name)) ?? "seed";
  return over === "seed" ? { over, values: [0, 1] } : { over, first: 0.4, last: 1, count: 5 };
}

interface RowProps {
  readonly number: number;
  readonly axis: Axis;
  readonly choices: Choices;
  onChange(axis: Axis): void;
  onRemove(): void;
}

function Row({ number, axis, choices, onChange, onRemove }: RowProps) {
  const { unit, value } = variedOf(choices, axis.over);
  const angles = useAngleUnit();
  const isList = axis.values !== undefined;
  const of = fillText(TEXTS.ofAxis, { number });

  function choose(over: string): void {
    const start = variedOf(choices, over).value;
    const isNumber = typeof start === "number" && start !== 0;
    onChange(
      isNumber
        ? { over, first: start, last: 2 * start, count: 5 }
        : { over, values: start === "" ? [] : [start] },
    );
  }

  function changeDefinition(definition: string): void {
    const first = typeof axis.values?.[0] === "number" ? axis.values[0] : value;
    const last = typeof axis.values?.at(-1) === "number" ? axis.values.at(-1) : value;
    if (definition === "values")
      onChange({ over: axis.over, values: [axis.first, axis.last].filter(isDefined) });
    else onChange({ over: axis.over, first, last, count: 5 } as Axis);
  }

  return (
    <fieldset className={studyFormStyles.row} aria-label={fillText(TEXTS.axis, { number })}>
      <VariedSelect
        label={fillText(TEXTS.labelOf, { label: TEXTS.parameter, owner: of })}
        value={axis.over}
        choices={choices}
        only={["experiment", "loop", "plant"]}
        onChange={choose}
      />
      <NativeSelect
        aria-label={fillText(TEXTS.labelOf, { label: TEXTS.definition, owner: of })}
        data={[
          { value: "range", label: TEXTS.range },
          { value: "values", label: TEXTS.values },
        ]}
        value={isList ? "values" : "range"}
        onChange={(event) => changeDefinition(event.currentTarget.value)}
      />
      {isList ? (
        <ValueList
          label={labelWith(TEXTS.values, unit, angles)}
          of={of}
          unit={unit}
          values={axis.values}
          onChange={(values) => onChange({ ...axis, values })}
        />
      ) : (
        <>
          <NumberBox
            label={TEXTS.from}
            of={of}
            unit={unit}
            value={axis.first}
            onChange={(first) => onChange({ ...axis, first })}
          />
          <NumberBox
            label={TEXTS.to}
            of={of}
            unit={unit}
            value={axis.last}
            onChange={(last) => onChange({ ...axis, last })}
          />
          <NumberBox
            label={TEXTS.count}
            of={of}
            unit="1"
            value={axis.count}
            onChange={(count) => onChange({ ...axis, count })}
          />
          <NativeSelect
            label={TEXTS.spacing}
            aria-label={fillText(TEXTS.labelOf, { label: TEXTS.spacing, owner: of })}
            data={[
              { value: "even", label: TEXTS.linear },
              { value: "factor", label: TEXTS.geometric },
            ]}
            value={axis.spacing ?? "even"}
            onChange={(event) => onChange({ ...axis, spacing: event.currentTarget.value })}
          />
        </>
      )}
      <ActionIcon
        variant="subtle"
        color="gray"
        aria-label={fillText(TEXTS.removeAxis, { number })}
        onClick={onRemove}
      >
        <TbX size={14} />
      </ActionIcon>
    </fieldset>
  );
}

function isDefined(value: Value | undefined): value is Value {
  return value !== undefined;
}

interface NumberBoxProps {
  readonly label: string;
  readonly of: string;
  readonly unit: string;
  readonly value: Value | undefined;
  onChange(value: number | string): void;
}

function NumberBox({ label, of, unit, value, onChange }: NumberBoxProps) {
  const angles = useAngleUnit();
  return (
    <NumberField
      label={labelWith(label, unit, angles)}
      aria-label={fillText(TEXTS.labelOf, { label: labelWith(label, unit, angles), owner: of })}
      size="xs"
      w={92}
      unit={unit}
      value={typeof value === "boolean" || value === undefined ? "" : value}
      onChange={onChange}
    />
  );
}

interface ValueListProps {
  readonly label: string;
  readonly of: string;
  readonly unit: string;
  readonly values: readonly Value[];
  onChange(values: Value[]): void;
}

/** Box of a list of values; keeps the typed text while its values are equal, so a trailing comma remains. */
function ValueList({ label, of, unit, values, onChange }: ValueListProps) {
  const angles = useAngleUnit();
  const [typed, setTyped] = useState("");
  const read = (text: string) => valuesIn(text, (word) => inSI(word, unit, angles));
  const isMine = JSON.stringify(read(typed)) === JSON.stringify(values);
  const texts = values.map((one) => (typeof one === "number" ? boxText(one, unit, angles) : String(one)));
  return (
    <TextInput
      label={label}
      aria-label={fillText(TEXTS.labelOf, { label, owner: of })}
      style={{ flex: 1, minWidth: 160 }}
      value={isMine && typed !== "" ? typed : texts.join(", ")}
      onChange={(event) => {
        setTyped(event.currentTarget.value);
        onChange(read(event.currentTarget.value));
      }}
    />
  );
}

/** Fields of the plant variation: which parameters vary, and by how much. */

interface SpreadRowsProps {
  readonly spread: readonly Spread[];
  readonly choices: Choices;
  onChange(spread: readonly Spread[]): void;
}

function SpreadRows({ spread, choices, onChange }: SpreadRowsProps) {
  const taken = new Set(spread.map(({ of }) => of));
  const further = ["motor.c0", "asymmetry.spring_A", ...choices.plant.map(({ name }) => name)].find(
    (name) => !taken.has(name),
  );
  return (
    <fieldset className={`${studyFormStyles.group} ${pageStyles.fields}`}>
      <legend>{TEXTS.spreads}</legend>
      {spread.map((one, index) => {
        const number = index + 1;
        const of = fillText(TEXTS.ofSpread, { number });
        const labelOf = (label: string) => fillText(TEXTS.labelOf, { label, owner: of });
        const isRelative = one.absolute === undefined;
        const set = (part: Partial<Spread>) => onChange(spread.with(index, { ...one, ...part }));
        return (
          <fieldset
            // biome-ignore lint/suspicious/noArrayIndexKey: a spread has no identity except its index
            key={index}
            className={studyFormStyles.row}
            aria-label={fillText(TEXTS.spread, { number })}
          >
            <VariedSelect
              label={labelOf(TEXTS.parameter)}
              value={one.of}
              choices={choices}
              only={["plant"]}
              onChange={(name) => set({ of: name })}
            />
            <NativeSelect
              aria-label={labelOf(TEXTS.distribution)}
              data={[
                { value: "uniform", label: TEXTS.uniform },
                { value: "normal", label: TEXTS.normal },
              ]}
              value={one.by ?? "uniform"}
              onChange={(event) => set({ by: event.currentTarget.value })}
            />
            <NativeSelect
              aria-label={labelOf(TEXTS.width)}
              data={[
                { value: "relative", label: TEXTS.relative },
                { value: "absolute", label: TEXTS.absolute },
              ]}
              value={isRelative ? "relative" : "absolute"}
              onChange={(event) => {
                const { relative, absolute, ...rest } = one;
                const width = event.currentTarget.value;
                onChange(spread.with(index, { ...rest, [width]: relative ?? absolute ?? 0.1 }));
              }}
            />
            <NumberBox
              label="±"
              of={of}
              unit={isRelative ? "1" : variedOf(choices, one.of).unit}
              value={isRelative ? one.relative : one.absolute}
              onChange={(value) => set(isRelative ? { relative: value } : { absolute: value })}
            />
            <ActionIcon
              variant="subtle"
              color="gray"
              aria-label={fillText(TEXTS.removeSpread, { number })}
              onClick={() => onChange(spread.toSpliced(index, 1))}
            >
              <TbX size={14} />
            </ActionIcon>
          </fieldset>
        );
      })}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          disabled={further === undefined}
          onClick={() => further && onChange([...spread, { of: further, relative: 0.1 }])}
        >
          {TEXTS.addSpread}
        </Button>
      </div>
    </fieldset>
  );
}

/** Form that edits the document of a study: name, experiment, settings, axes, plants and seeds. */

interface StudyFormProps {
  readonly document: StudyDocument;
  onChange(document: StudyDocument): void;
}

export function StudyForm({ document, onChange }: StudyFormProps) {
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const experiment = document.experiment ?? "tracking";
  const choices = useVaried(experiment);
  const set = (part: Partial<StudyDocument>) => onChange({ ...document, ...part });
  const known = kinds.some(({ name }) => name === experiment);
  return (
    <fieldset className={studyFormStyles.form} aria-label={TEXTS.form}>
      <div className={studyFormStyles.row}>
        <TextInput
          label={TEXTS.name}
          value={document.name ?? ""}
          onChange={(event) => set({ name: event.currentTarget.value })}
        />
        <TextInput
          label={TEXTS.studyTitle}
          style={{ flex: 1 }}
          value={document.title ?? ""}
          onChange={(event) => set({ title: event.currentTarget.value })}
        />
        {document.written === undefined ? (
          <NativeSelect
            label={TEXTS.experiment}
            data={[
              ...(known ? [] : [{ value: experiment, label: experiment }]),
              ...kinds.map(({ name, title }) => ({ value: name, label: title })),
            ]}
            value={experiment}
            onChange={(event) => set({ experiment: event.currentTarget.value })}
          />
        ) : (
          <span className={pageStyles.dim}>{TEXTS.experimentInText}</span>
        )}
      </div>
      <FixedSettings
        settings={document.settings ?? {}}
        choices={choices}
        onChange={(settings) => set({ settings })}
      />
      <AxisRows axes={document.axes ?? []} choices={choices} onChange={(axes) => set({ axes })} />
      <SpreadRows spread={document.spread ?? []} choices={choices} onChange={(spread) => set({ spread })} />
      <div className={studyFormStyles.row}>
        <NumberBox
          label={TEXTS.plants}
          of={TEXTS.toDraw}
          unit="1"
          value={document.draws ?? 1}
          onChange={(draws) => set({ draws })}
        />
        <NumberBox
          label={TEXTS.seeds}
          of={TEXTS.ofNoise}
          unit="1"
          value={document.seeds ?? 1}
          onChange={(seeds) => set({ seeds })}
        />
        <NumberBox
          label={TEXTS.seed}
          of={TEXTS.ofDraws}
          unit="1"
          value={document.seed ?? 0}
          onChange={(seed) => set({ seed })}
        />
      </div>
    </fieldset>
  );
}

interface FixedProps {
  readonly settings: Readonly<Record<string, Value>>;
  readonly choices: Choices;
  onChange(settings: Readonly<Record<string, Value>>): void;
}

/** Fields of the settings that are the same in all runs and replace the default or active values. */
function FixedSettings({ settings, choices, onChange }: FixedProps) {
  const entries = Object.entries(settings);
  const replace = (index: number, entry: [string, Value]) =>
    onChange(Object.fromEntries(entries.with(index, entry)));
  const further = [...choices.experiment, ...choices.loop].find(({ name }) => !(name in settings));
  return (
    <fieldset className={`${studyFormStyles.group} ${pageStyles.fields}`}>
      <legend>{TEXTS.fixedSettings}</legend>
      {entries.map(([name, value], index) => (
        <fieldset
          key={name}
          className={studyFormStyles.row}
          aria-label={fillText(TEXTS.setting, { number: index + 1 })}
        >
          <VariedSelect
            label={fillText(TEXTS.settingName, { number: index + 1 })}
            value={name}
            choices={choices}
            only={["experiment", "loop"]}
            onChange={(next) => replace(index, [next, variedOf(choices, next).value])}
          />
          <SettingBox
            of={fillText(TEXTS.ofSetting, { number: index + 1 })}
            unit={variedOf(choices, name).unit}
            usual={variedOf(choices, name).value}
            value={value}
            onChange={(next) => replace(index, [name, next])}
          />
          <ActionIcon
            variant="subtle"
            color="gray"
            aria-label={fillText(TEXTS.removeSetting, { number: index + 1 })}
            onClick={() => onChange(Object.fromEntries(entries.toSpliced(index, 1)))}
          >
            <TbX size={14} />
          </ActionIcon>
        </fieldset>
      ))}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          disabled={further === undefined}
          onClick={() => further && onChange({ ...settings, [further.name]: further.value })}
        >
          {TEXTS.addSetting}
        </Button>
      </div>
    </fieldset>
  );
}

interface BoxProps {
  readonly of: string;
  readonly unit: string;
  readonly usual: Value;
  readonly value: Value;
  onChange(value: Value): void;
}

function SettingBox({ of, unit, usual, value, onChange }: BoxProps) {
  if (typeof usual === "boolean" || typeof value === "boolean") {
    return (
      <NativeSelect
        aria-label={fillText(TEXTS.labelOf, { label: TEXTS.value, owner: of })}
        data={["false", "true"]}
        value={String(value)}
        onChange={(event) => onChange(event.currentTarget.value === "true")}
      />
    );
  }
  if (typeof usual === "number") {
    return <NumberBox label={TEXTS.value} of={of} unit={unit} value={value} onChange={onChange} />;
  }
  return (
    <TextInput
      label={TEXTS.value}
      aria-label={fillText(TEXTS.labelOf, { label: TEXTS.value, owner: of })}
      value={value}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
