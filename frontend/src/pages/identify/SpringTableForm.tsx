/** A spring measured elsewhere: a CSV file in, its characteristic out. */

import { Button, FileInput } from "@mantine/core";
import { useState } from "react";
import { ChoiceField } from "../../components/ChoiceField";
import { Refusal } from "../../components/Refusal";
import { TextField } from "../../components/TextField";
import { useAddSpringTable } from "../../service/commands";
import { RefusedFields, useRefusedInput } from "../../service/refusedFields";
import page from "../Page.module.css";

const DECIMALS = [
  { value: "", label: "found from the numbers" },
  { value: "point", label: "point, as in 8.5" },
  { value: "comma", label: "comma, as in 8,5" },
];

export function SpringTableForm({ onTable }: { onTable: (id: number) => void }) {
  const add = useAddSpringTable();
  const [file, setFile] = useState<File | null>(null);
  const [decimal, setDecimal] = useState("");
  const [header, setHeader] = useState("");

  const isLine = /^([1-9]\d{0,5})?$/.test(header);

  async function read(chosen: File | null): Promise<void> {
    setFile(chosen);
    if (chosen === null || !isLine) return;
    const body = {
      name: chosen.name,
      table: await chosen.text(),
      decimal: decimal === "point" || decimal === "comma" ? decimal : null,
      header: header === "" ? null : Number(header),
    } as const;
    add.mutate(body, { onSuccess: (table) => onTable(table.id) });
  }

  return (
    <RefusedFields error={add.error} only="table">
      <form className={page.fields} aria-label="Measured table" onSubmit={(event) => event.preventDefault()}>
        <TableFile reading={add.isPending} onChange={read} />
        <ChoiceField
          name="decimal"
          label="Decimal mark of the table"
          data={DECIMALS}
          value={decimal}
          onChange={setDecimal}
        />
        <TextField
          name="header"
          label="Line that names the columns"
          description="found where it is left empty"
          value={header}
          problem={isLine ? null : "a whole number from 1"}
          onChange={(text) => setHeader(text.trim())}
        />
        {add.isError && file !== null && (
          <Button variant="default" loading={add.isPending} onClick={() => read(file)}>
            Read {file.name} again
          </Button>
        )}
        <Refusal error={add.error} />
      </form>
    </RefusedFields>
  );
}

function TableFile({ reading, onChange }: { reading: boolean; onChange: (file: File | null) => void }) {
  const { ref, said } = useRefusedInput<HTMLButtonElement>("table");
  return (
    <FileInput
      ref={ref}
      label="Or a table measured elsewhere (CSV)"
      description="columns x [m] or x [mm], and F [N]; units in the heading"
      inputWrapperOrder={["label", "input", "description", "error"]}
      placeholder="Choose a file"
      accept=".csv,text/csv,text/plain"
      value={null}
      error={said}
      disabled={reading}
      onChange={onChange}
    />
  );
}
