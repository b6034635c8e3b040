/** A text of a form, told at the field when it is refused. */

import { TextInput, type TextInputProps } from "@mantine/core";
import type { Entry } from "../service/glossary";
import { useRefusedInput } from "../service/refusedFields";
import { help } from "./help";

interface TextFieldProps extends Omit<TextInputProps, "error" | "onChange"> {
  readonly value: string;
  /** Where the value stands in what is sent, as refusals name it; the name of the box if left out. */
  readonly place?: string;
  /** Where there is no room below the field: the element that says why it is refused. */
  readonly saidAt?: string;
  /** What the page itself finds wrong with the text. */
  readonly problem?: string | null;
  /** What it is for. */
  readonly entry?: Entry | undefined;
  onChange(text: string): void;
}

export function TextField(props: TextFieldProps) {
  const { place = props.name, saidAt, problem = null, entry, onChange, ...rest } = props;
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, saidAt);
  return (
    <TextInput
      {...rest}
      {...help(entry)}
      ref={ref}
      inputWrapperOrder={["label", "input", "description", "error"]}
      error={problem ?? (saidAt === undefined ? said : said !== null)}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
