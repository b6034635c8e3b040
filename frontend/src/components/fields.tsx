/** Inputs of forms: numbers, texts, choices, switches and declared settings. */

import {
  NativeSelect,
  type NativeSelectProps,
  Switch,
  type SwitchProps,
  TextInput,
  type TextInputProps,
} from "@mantine/core";
import { useDebouncedCallback } from "@mantine/hooks";
import { useEffect, useRef, useState } from "react";
import { capital, notANumber } from "../samples/format";
import { boxText, inSI, labelWith, rangeText, readingOf } from "../samples/quantity";
import { useAngleUnit } from "../service/api/preferences";
import { useDescribedBy, useRefusedInput } from "../service/forms/refusals";
import { type Entry, settingEntry } from "../service/glossary";
import type { Setting } from "../wire/types";
import { help } from "./Shortcuts";

/** Number of a form. Invalid text remains, with an error mark, and is passed on as text; no form sends it. */

interface NumberFieldProps
  extends Pick<
    TextInputProps,
    "name" | "label" | "aria-label" | "description" | "disabled" | "size" | "w" | "styles"
  > {
  /** Value in SI; typed and shown in the person's unit. */
  readonly value: number | string;
  readonly unit?: string;
  /** Path of the value in the request, as refusals name it; by default the name of the input. */
  readonly place?: string;
  /** Id of the element that shows the error, if there is no space below the box. */
  readonly messageId?: string;
  /** Glossary entry of the input. */
  readonly entry?: Entry | undefined;
  onChange(value: number | string): void;
}

export function NumberField(props: NumberFieldProps) {
  const { value, unit = "1", place = props.name, messageId, entry, onChange, ...rest } = props;
  const { onFocus, onBlur, ...helped } = help(entry);
  const angles = useAngleUnit();
  const [typed, setTyped] = useState<string | null>(null);
  const before = useRef(value);
  const { ref, said } = useRefusedInput<HTMLInputElement>(rest.disabled ? undefined : place, messageId);
  const odd = typeof value === "string" && !rest.disabled ? notANumber(value) : null;
  useDescribedBy(ref, odd === null ? undefined : messageId);
  const problem = odd ?? said;
  // While a person types "1.", the value is the number 1, and the point remains.
  const mine = typed !== null && (inSI(typed, unit, angles) ?? typed) === value;
  return (
    <TextInput
      {...rest}
      {...helped}
      autoComplete="off"
      inputWrapperOrder={["label", "input", "description", "error"]}
      value={mine ? typed : typeof value === "number" ? boxText(value, unit, angles) : value}
      ref={ref}
      error={messageId === undefined ? problem : problem !== null}
      onFocus={(event) => {
        before.current = value;
        onFocus?.(event);
      }}
      onChange={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        onChange(inSI(text, unit, angles) ?? text);
      }}
      onBlur={(event) => {
        setTyped(null);
        onBlur?.(event);
      }}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        setTyped(null);
        onChange(before.current);
      }}
    />
  );
}

/** Text of a form; a refusal is shown at the field. */

interface TextFieldProps extends Omit<TextInputProps, "error" | "onChange"> {
  readonly value: string;
  /** Path of the value in the request, as refusals name it; by default the name of the input. */
  readonly place?: string;
  /** Id of the element that shows the refusal, if there is no space below the field. */
  readonly messageId?: string;
  /** Error that the page itself found in the text. */
  readonly problem?: string | null;
  /** Glossary entry of the input. */
  readonly entry?: Entry | undefined;
  onChange(text: string): void;
}

export function TextField(props: TextFieldProps) {
  const { place = props.name, messageId, problem = null, entry, onChange, ...rest } = props;
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, messageId);
  return (
    <TextInput
      {...rest}
      {...help(entry)}
      ref={ref}
      inputWrapperOrder={["label", "input", "description", "error"]}
      error={problem ?? (messageId === undefined ? said : said !== null)}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Choice from a list; a refusal is shown at the field. */

interface ChoiceFieldProps extends Omit<NativeSelectProps, "error" | "onChange"> {
  /** Glossary entry of the input. */
  readonly entry?: Entry | undefined;
  onChange(value: string): void;
}

export function ChoiceField(props: ChoiceFieldProps) {
  const { entry, onChange, ...rest } = props;
  const { ref, said } = useRefusedInput<HTMLSelectElement>(rest.name);
  return (
    <NativeSelect
      {...rest}
      {...help(entry)}
      ref={ref}
      inputWrapperOrder={["label", "input", "description", "error"]}
      error={said}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Switch; a refusal is shown at the switch. */

interface SwitchFieldProps extends Omit<SwitchProps, "error" | "onChange"> {
  /** Also the path of the value in the request, as refusals name it. */
  readonly name: string;
  /** Glossary entry of the input. */
  readonly entry?: Entry | undefined;
  onChange(checked: boolean): void;
}

function SwitchField({ entry, onChange, ...rest }: SwitchFieldProps) {
  const { ref, said } = useRefusedInput<HTMLInputElement>(rest.name);
  return (
    <Switch
      {...rest}
      {...help(entry)}
      ref={ref}
      error={said}
      aria-invalid={said !== null}
      onChange={(event) => onChange(event.currentTarget.checked)}
    />
  );
}

/** Declared setting as an input with its unit and bounds. */

export type SettingValue = boolean | number | string;

interface SettingFieldProps {
  readonly setting: Setting;
  /** Text instead of a number if the typed text is not a number. */
  readonly value: SettingValue;
  /** Origin of the value: active, default, edited. */
  readonly origin?: string;
  onChange(value: SettingValue): void;
}

export function SettingField({ setting, value, origin = "", onChange }: SettingFieldProps) {
  const { name, meaning, unit, minimum, maximum, choices } = setting;
  const angles = useAngleUnit();
  const label = labelWith(capital(meaning), unit, angles);
  const entry = settingEntry(setting, angles);
  if (typeof value === "boolean") {
    return (
      <SwitchField
        name={name}
        label={label}
        description={origin}
        entry={entry}
        checked={value}
        onChange={onChange}
      />
    );
  }
  if (choices && choices.length > 0) {
    return (
      <ChoiceField
        name={name}
        label={label}
        description={origin}
        entry={entry}
        data={[...choices]}
        value={String(value)}
        onChange={onChange}
      />
    );
  }
  if (isNumeric(setting)) {
    const bounds = minimum != null && maximum != null ? rangeText(minimum, maximum, unit, angles) : "";
    return (
      <NumberField
        name={name}
        label={label}
        description={[bounds, origin].filter((part) => part !== "").join("; ")}
        unit={unit}
        entry={entry}
        value={value}
        onChange={onChange}
      />
    );
  }
  return <TextField name={name} label={label} entry={entry} value={String(value)} onChange={onChange} />;
}

/** Whether a setting is a number. */
function isNumeric(setting: Setting): boolean {
  return typeof setting.default === "number";
}

/** Text that is committed by Enter or by leaving the box; Escape restores the previous text. */

interface EditedTextProps {
  readonly label: string;
  readonly text: string;
  onDone(text: string): void;
}

export function CommittedTextInput({ label, text, onDone }: EditedTextProps) {
  const [typed, setText] = useState(text);
  useEffect(() => setText(text), [text]);
  const done = () => {
    if (typed !== text) onDone(typed);
  };
  return (
    <TextInput
      aria-label={label}
      value={typed}
      maxLength={40}
      w={170}
      onChange={(event) => setText(event.currentTarget.value)}
      onBlur={done}
      onKeyDown={(event) => {
        if (event.key === "Enter") done();
        if (event.key === "Escape") setText(text);
      }}
    />
  );
}

/** Number that takes effect after a pause in typing, because each change causes a request. */

const RESTED_MS = 400;

interface SettledNumberProps {
  readonly label: string;
  /** Value in SI; null without a value. */
  readonly value: number | null;
  readonly unit?: string;
  /** Text before the number in its box. */
  readonly before: string;
  /** Error of a number; empty if there is none. */
  fits(value: number): string;
  /** Whether the box may be empty. */
  readonly optional?: boolean;
  onChange(value: number | null): void;
}

export function DebouncedNumberField(props: SettledNumberProps) {
  const { label, before, value, unit = "1", fits, optional, onChange } = props;
  const angles = useAngleUnit();
  const [typed, setTyped] = useState<string | null>(null);
  const settle = useDebouncedCallback((text: string) => {
    const found = inSI(text, unit, angles);
    if (text.trim() === "" && optional) onChange(null);
    else if (found !== null && fits(found) === "") onChange(found);
  }, RESTED_MS);
  const shown = typed ?? (value === null ? "" : boxText(value, unit, angles));
  return (
    <TextInput
      aria-label={labelWith(label, unit, angles)}
      placeholder={label}
      autoComplete="off"
      leftSection={before}
      rightSection={unit === "1" ? null : readingOf(unit, angles).unit}
      rightSectionWidth={70}
      w={170}
      value={shown}
      error={typed === null ? null : wrongWith(typed)}
      onChange={({ currentTarget }) => {
        setTyped(currentTarget.value);
        settle(currentTarget.value);
      }}
      onBlur={() => {
        settle.flush();
        if (wrongWith(shown) === null) setTyped(null);
      }}
    />
  );

  function wrongWith(text: string): string | null {
    if (text.trim() === "" && optional) return null;
    const found = inSI(text, unit, angles);
    if (found === null) return notANumber(text);
    return fits(found) || null;
  }
}
