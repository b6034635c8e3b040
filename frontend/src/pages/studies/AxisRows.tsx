/** The axes of a study: what is gone through, by a range or by single values. */

import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { useState } from "react";
import { TbPlus, TbX } from "react-icons/tb";
import { NumberField } from "../../components/NumberField";
import { boxText, inSI, labelWith } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import page from "../Page.module.css";
import styles from "./StudyForm.module.css";
import { type Axis, type Value, valuesIn } from "./studyDocument";
import { VariedSelect } from "./VariedSelect";
import { type Choices, variedOf } from "./varied";

interface AxisRowsProps {
  readonly axes: readonly Axis[];
  readonly choices: Choices;
  onChange(axes: readonly Axis[]): void;
}

export function AxisRows({ axes, choices, onChange }: AxisRowsProps) {
  return (
    <fieldset className={`${styles.group} ${page.fields}`}>
      <legend>Axes: all combinations, the last one fastest</legend>
      {axes.map((axis, index) => (
        <Row
          // biome-ignore lint/suspicious/noArrayIndexKey: an axis is its place in the list
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
          Add axis
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
  const angles = useAngles();
  const isList = axis.values !== undefined;
  const of = `of axis ${number}`;

  function choose(over: string): void {
    const start = variedOf(choices, over).value;
    const isNumber = typeof start === "number" && start !== 0;
    onChange(
      isNumber
        ? { over, first: start, last: 2 * start, count: 5 }
        : { over, values: start === "" ? [] : [start] },
    );
  }

  function turn(way: string): void {
    const first = typeof axis.values?.[0] === "number" ? axis.values[0] : value;
    const last = typeof axis.values?.at(-1) === "number" ? axis.values.at(-1) : value;
    if (way === "values") onChange({ over: axis.over, values: [axis.first, axis.last].filter(isThere) });
    else onChange({ over: axis.over, first, last, count: 5 } as Axis);
  }

  return (
    <fieldset className={styles.row} aria-label={`Axis ${number}`}>
      <VariedSelect
        label={`Varied by axis ${number}`}
        value={axis.over}
        choices={choices}
        only={["experiment", "loop", "plant"]}
        onChange={choose}
      />
      <NativeSelect
        aria-label={`Given as ${of}`}
        data={[
          { value: "range", label: "range" },
          { value: "values", label: "values" },
        ]}
        value={isList ? "values" : "range"}
        onChange={(event) => turn(event.currentTarget.value)}
      />
      {isList ? (
        <ValueList
          label={labelWith("Values", unit, angles)}
          of={of}
          unit={unit}
          values={axis.values}
          onChange={(values) => onChange({ ...axis, values })}
        />
      ) : (
        <>
          <NumberBox
            label="From"
            of={of}
            unit={unit}
            value={axis.first}
            onChange={(first) => onChange({ ...axis, first })}
          />
          <NumberBox
            label="To"
            of={of}
            unit={unit}
            value={axis.last}
            onChange={(last) => onChange({ ...axis, last })}
          />
          <NumberBox
            label="Number"
            of={of}
            unit="1"
            value={axis.count}
            onChange={(count) => onChange({ ...axis, count })}
          />
          <NativeSelect
            label="Spacing"
            aria-label={`Spacing ${of}`}
            data={["even", "factor"]}
            value={axis.spacing ?? "even"}
            onChange={(event) => onChange({ ...axis, spacing: event.currentTarget.value })}
          />
        </>
      )}
      <ActionIcon variant="subtle" color="gray" aria-label={`Remove axis ${number}`} onClick={onRemove}>
        <TbX size={14} />
      </ActionIcon>
    </fieldset>
  );
}

function isThere(value: Value | undefined): value is Value {
  return value !== undefined;
}

interface NumberBoxProps {
  readonly label: string;
  readonly of: string;
  readonly unit: string;
  readonly value: Value | undefined;
  onChange(value: number | string): void;
}

export function NumberBox({ label, of, unit, value, onChange }: NumberBoxProps) {
  const angles = useAngles();
  return (
    <NumberField
      label={labelWith(label, unit, angles)}
      aria-label={`${labelWith(label, unit, angles)} ${of}`}
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

/** Keeps what is typed while it says the same: a comma at the end is not taken away. */
function ValueList({ label, of, unit, values, onChange }: ValueListProps) {
  const angles = useAngles();
  const [typed, setTyped] = useState("");
  const read = (text: string) => valuesIn(text, (word) => inSI(word, unit, angles));
  const isMine = JSON.stringify(read(typed)) === JSON.stringify(values);
  const told = values.map((one) => (typeof one === "number" ? boxText(one, unit, angles) : String(one)));
  return (
    <TextInput
      label={label}
      aria-label={`${label} ${of}`}
      style={{ flex: 1, minWidth: 160 }}
      value={isMine && typed !== "" ? typed : told.join(", ")}
      onChange={(event) => {
        setTyped(event.currentTarget.value);
        onChange(read(event.currentTarget.value));
      }}
    />
  );
}
