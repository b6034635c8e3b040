/** A spring measured elsewhere: a CSV file in, its characteristic out. */

import { FileInput } from "@mantine/core";
import { Refusal } from "../../components/Refusal";
import { useAddSpringTable } from "../../service/commands";
import { RefusedFields, useRefusedInput } from "../../service/refusedFields";
import page from "../Page.module.css";

export function SpringTableForm({ onTable }: { onTable: (id: number) => void }) {
  const add = useAddSpringTable();

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    add.mutate({ name: file.name, table: await file.text() }, { onSuccess: (table) => onTable(table.id) });
  }

  return (
    <RefusedFields error={add.error} only="table">
      <form className={page.fields} aria-label="Measured table">
        <TableFile reading={add.isPending} onChange={read} />
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
