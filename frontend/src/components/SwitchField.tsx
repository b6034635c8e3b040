/** On or off, told at the switch when it is refused. */

import { Switch, type SwitchProps } from "@mantine/core";
import { useRefusedInput } from "../service/refusedFields";

interface SwitchFieldProps extends Omit<SwitchProps, "error" | "onChange"> {
  /** Also where the value stands in what is sent, as refusals name it. */
  readonly name: string;
  onChange(checked: boolean): void;
}

export function SwitchField({ onChange, ...rest }: SwitchFieldProps) {
  const { ref, said } = useRefusedInput<HTMLInputElement>(rest.name);
  return (
    <Switch
      {...rest}
      ref={ref}
      error={said}
      aria-invalid={said !== null}
      onChange={(event) => onChange(event.currentTarget.checked)}
    />
  );
}
