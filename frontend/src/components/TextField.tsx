/** A text of a form, told at the field when it is refused. */

import { TextInput, type TextInputProps } from "@mantine/core";
import { useRefusedInput } from "../service/refusedFields";

interface TextFieldProps extends Omit<TextInputProps, "error" | "onChange"> {
  readonly value: string;
  /** Where the value stands in what is sent, as refusals name it; the name of the box if left out. */
  readonly place?: string;
  /** Where there is no room below the field: the element that says why it is refused. */
  readonly saidAt?: string;
  /** What the page itself finds wrong with the text. */
  readonly problem?: string | null;
  onChange(text: string): void;
}

export function TextField(props: TextFieldProps) {
  const { place = props.name, saidAt, problem = null, onChange, ...rest } = props;
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, saidAt);
  return (
    <TextInput
      {...rest}
      ref={ref}
      inputWrapperOrder={["label", "input", "description", "error"]}
      error={problem ?? (saidAt === undefined ? said : said !== null)}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
