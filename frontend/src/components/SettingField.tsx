/** One declared setting as an input with its unit and bounds. */

import { NativeSelect, NumberInput, Switch, TextInput } from "@mantine/core";
import type { Setting } from "../wire/types";

export type SettingValue = boolean | number | string;

interface SettingFieldProps {
  readonly setting: Setting;
  readonly value: SettingValue;
  onChange(value: SettingValue): void;
}

export function SettingField({ setting, value, onChange }: SettingFieldProps) {
  const { meaning, unit, minimum, maximum, choices } = setting;
  const label = unit === "1" || unit === "" ? capital(meaning) : `${capital(meaning)} [${unit}]`;
  if (typeof value === "boolean") {
    return (
      <Switch label={label} checked={value} onChange={(event) => onChange(event.currentTarget.checked)} />
    );
  }
  if (choices && choices.length > 0) {
    return (
      <NativeSelect
        label={label}
        data={[...choices]}
        value={String(value)}
        onChange={(event) => onChange(event.currentTarget.value)}
      />
    );
  }
  if (typeof setting.default === "number" || setting.minimum != null) {
    const bounded = minimum != null && maximum != null;
    return (
      <NumberInput
        label={label}
        description={bounded ? `${minimum} … ${maximum}` : undefined}
        inputWrapperOrder={["label", "input", "description", "error"]}
        value={typeof value === "number" ? value : ""}
        hideControls
        onChange={(next) => onChange(next === "" ? "" : Number(next))}
      />
    );
  }
  return (
    <TextInput
      label={label}
      value={String(value)}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
