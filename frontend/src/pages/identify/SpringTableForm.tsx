/** A spring measured elsewhere: a CSV file in, its characteristic out. */

import { FileInput } from "@mantine/core";
import { Refusal } from "../../components/Refusal";
import { useAddSpringTable } from "../../service/commands";
import page from "../Page.module.css";

export function SpringTableForm({ onTable }: { onTable: (id: number) => void }) {
  const add = useAddSpringTable();

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    add.mutate({ name: file.name, table: await file.text() }, { onSuccess: (table) => onTable(table.id) });
  }

  return (
    <form className={page.fields} aria-label="Measured table">
      <FileInput
        label="Or a table measured elsewhere (CSV)"
        description="columns x [m] or x [mm], and F [N]; units in the heading"
        inputWrapperOrder={["label", "input", "description"]}
        placeholder="Choose a file"
        accept=".csv,text/csv,text/plain"
        value={null}
        disabled={add.isPending}
        onChange={read}
      />
      <Refusal error={add.error} />
    </form>
  );
}
