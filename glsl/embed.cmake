# Writes OUTPUT: a C++ file that defines NAMESPACE::embedded_glsl() of HEADER, with every GLSL file under ROOT as a string, by its
# path below ROOT.
file(GLOB_RECURSE files RELATIVE ${ROOT} ${ROOT}/*.glsl ${ROOT}/*.vert ${ROOT}/*.frag ${ROOT}/*.comp ${ROOT}/*.h)
list(SORT files)
set(text "// Generated from glsl/ by embed.cmake.\n#include \"${HEADER}\"\n\nnamespace ${NAMESPACE} {\n\n")
string(APPEND text "const std::map<std::string, std::string>& embedded_glsl() {\n")
string(APPEND text "    static const std::map<std::string, std::string> files = {\n")
foreach(file ${files})
  file(READ ${ROOT}/${file} body)
  string(APPEND text "        {\"${file}\", R\"__glsl__(${body})__glsl__\"},\n")
endforeach()
string(APPEND text "    };\n    return files;\n}\n\n} // namespace ${NAMESPACE}\n")
file(WRITE ${OUTPUT} "${text}")
