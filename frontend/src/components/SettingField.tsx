/** One declared setting as an input with its unit and bounds. */

import { NativeSelect, Switch, TextInput } from "@mantine/core";
import { labelWith, rangeText } from "../samples/quantity";
import { useAngles } from "../service/angles";
import type { Setting } from "../wire/types";
import { NumberField } from "./NumberField";

export type SettingValue = boolean | number | string;

interface SettingFieldProps {
  readonly setting: Setting;
  /** Text where a number is wanted: what was typed is none. */
  readonly value: SettingValue;
  /** Where the value comes from: in force, default, changed here. */
  readonly origin?: string;
  onChange(value: SettingValue): void;
}

export function SettingField({ setting, value, origin = "", onChange }: SettingFieldProps) {
  const { name, meaning, unit, minimum, maximum, choices } = setting;
  const angles = useAngles();
  const label = labelWith(capital(meaning), unit, angles);
  if (typeof value === "boolean") {
    return (
      <Switch
        name={name}
        label={label}
        description={origin}
        checked={value}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    );
  }
  if (choices && choices.length > 0) {
    return (
      <NativeSelect
        name={name}
        label={label}
        description={origin}
        inputWrapperOrder={["label", "input", "description", "error"]}
        data={[...choices]}
        value={String(value)}
        onChange={(event) => onChange(event.currentTarget.value)}
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
        value={value}
        onChange={onChange}
      />
    );
  }
  return (
    <TextInput
      name={name}
      label={label}
      value={String(value)}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Whether a setting takes a number. */
export function isNumeric(setting: Setting): boolean {
  return typeof setting.default === "number";
}

function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
