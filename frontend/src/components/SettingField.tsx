/** One declared setting as an input with its unit and bounds. */

import { labelWith, rangeText } from "../samples/quantity";
import { capital } from "../samples/words";
import { useAngles } from "../service/angles";
import { settingEntry } from "../service/fieldHelp";
import type { Setting } from "../wire/types";
import { ChoiceField } from "./ChoiceField";
import { NumberField } from "./NumberField";
import { SwitchField } from "./SwitchField";
import { TextField } from "./TextField";

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

/** Whether a setting takes a number. */
export function isNumeric(setting: Setting): boolean {
  return typeof setting.default === "number";
}
